"""Random machines of the validation as elements that can stand beside others."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from stickslip import GROUND
from validation.against_oracles import scene_of
from validation.machine_scenes import FAMILIES


def machine(family: str, number: int, prefix: str) -> list[Any]:
    """Return the elements of a machine, with a prefix before all names but that of the ground."""
    return [_named(one, prefix) for one in scene_of(FAMILIES[family][0](number), order=None).elements]


def _named(element: Any, prefix: str) -> Any:
    def new(name: str) -> str:
        return prefix + name if name and name != GROUND else name

    own = {one.name: getattr(element, one.name) for one in fields(element)}
    changed = {key: new(own[key]) for key in ("name", "a", "b", "body") if isinstance(own.get(key), str)}
    if "coefficients" in own:
        changed["coefficients"] = {new(name): c for name, c in own["coefficients"].items()}
    return replace(element, **changed)
