"""A sweep over the numbers of a scene file: which of them vary, and what is read of each run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip.model.elements import KINDS
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results.units import units
from stickslip.simulation.result import Result
from stickslip.simulation.simulate import simulate

__all__ = ["SceneRuns", "values_of"]


@dataclass(frozen=True)
class SceneRuns:
    """Runs of a scene in plain data, with some of its fields changed: what `sweep` evaluates.

    A field is called ``NAME.FIELD``, with the name of a body, drive, contact or another element, or, where elements
    have no name, ``TABLE.NUMBER.FIELD``, counted from 0. Fields of laws and signals follow after a point:
    ``brake.law.mu_static``.

    Parameters
    ----------
    data : mapping
        What `Scene.to_dict` returns.
    t_span : (float, float)
        Start and end in s.
    options : mapping
        Arguments of `simulate`.
    """

    data: Mapping[str, Any]
    t_span: Sequence[float]
    options: Mapping[str, Any]

    def scene(self, point: Mapping[str, Any]) -> Scene:
        """Return the scene with the fields that a point names.

        Raises
        ------
        ValueError, TypeError
            If there is no such field, or it refuses the value.
        """
        data = deepcopy(dict(self.data))
        for path, value in point.items():
            _set(data, path, value)
        return Scene.from_dict(data)

    def __call__(self, **point: Any) -> dict[str, float]:
        """Simulate one point; return events, last velocities, and of each contact its stuck part and its heat."""
        return _read(simulate(self.scene(point), self.t_span, **self.options))

    def units(self, path: str) -> str:
        """Return the unit of a value or a field, or an empty text where it has none or is not known."""
        scene = Scene.from_dict(self.data)
        kind, _, name = path.partition(" ")
        if kind in ("velocity", "heat") and name:
            return units(scene).velocity if kind == "velocity" else "J"
        of_field = {"normal": "N", "dwell": "s", "rested": "s"}
        unit = units(scene)
        for field in ("inertia", "velocity", "position", "stiffness", "damping"):
            of_field[field] = getattr(unit, field)
        return of_field.get(path.rpartition(".")[2], "")


def values_of(text: str) -> list[float]:
    """Return the values that a text lists: ``1,2,5``, or ``START:STOP:COUNT`` evenly, or with ``:log`` in ratios.

    Raises
    ------
    ValueError
        If it lists no numbers.
    """
    try:
        if ":" not in text:
            return [float(part) for part in text.split(",")]
        start, stop, count, *rest = text.split(":")
        if rest not in ([], ["log"]) or int(count) < 1:
            raise ValueError
        ends = float(start), float(stop)
        spaced = np.geomspace(*ends, int(count)) if rest else np.linspace(*ends, int(count))
    except ValueError:
        raise ValueError(
            f"{text!r} lists no values; write 0.1,0.2,0.5 or START:STOP:COUNT such as 0:1:11, or 0.01:1:9:log"
        ) from None
    if not all(map(math.isfinite, spaced)):
        raise ValueError(f"{text!r} lists values that are not finite; with :log both ends must be positive")
    return [float(value) for value in spaced]


def _set(data: dict[str, Any], path: str, value: Any) -> None:
    """Write a value into plain data."""
    name, *fields = path.split(".")
    if name in KINDS:
        number, *fields = fields or [""]
        table = data.get(name, [])
        if not number.isdigit() or int(number) >= len(table):
            raise ValueError(f"{path}: {name} has the numbers 0 to {len(table) - 1}, got {number!r}")
        row = table[int(number)]
    else:
        rows = [one for kind in KINDS for one in data.get(kind, []) if one.get("name") == name]
        if len(rows) != 1:
            known = [one["name"] for kind in KINDS for one in data.get(kind, []) if "name" in one]
            found = "several elements are" if rows else "no element is"
            raise ValueError(
                f"{path}: {found} called {name!r}; write NAME.FIELD with one of {', '.join(known)}, "
                "or TABLE.NUMBER.FIELD such as springs.0.stiffness"
            )
        row = rows[0]
    if not fields:
        raise ValueError(f"{path}: which field of {name!r} varies? write {path}.FIELD")
    for field in fields[:-1]:
        row = row.get(field)
        if not isinstance(row, dict):
            raise ValueError(f"{path}: {field!r} of {name!r} has no fields of its own")
    row[fields[-1]] = value


def _read(result: Result) -> dict[str, float]:
    found: dict[str, float] = {"events": float(len(result.events))}
    found |= {f"velocity {body.name}": result.velocity(body.name)[-1] for body in result.scene.bodies}
    found |= {f"stuck {row.name}": result.share(row.name)[Mode.STUCK] for row in result.scene.contacts}
    return found | {f"heat {name}": heat[-1] for name, heat in result.energy().contacts.items()}
