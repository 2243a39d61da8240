"""Scenes with exact answers (40-digit arithmetic, rounded to double), as the package's own elements."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stickslip import Body, Contact, Drive, DryFriction, Force, Scene, Spring, piecewise_linear

FOLDER = Path(__file__).parent / "reference"
NAMES = sorted(path.stem for path in FOLDER.glob("*.json"))


@dataclass(frozen=True)
class Reference:
    """A scene and its exact answer."""

    name: str
    scene: Scene
    stop: float
    events: list[tuple[float, str, int, int]]
    t: np.ndarray
    v: np.ndarray
    bodies: list[str]


def load(name: str) -> Reference:
    data = json.loads((FOLDER / f"{name}.json").read_text())
    scene, answer = data["scene"], data["answer"]
    return Reference(
        name,
        _scene(scene),
        float(scene["t_end"]),
        [(t, contact, before, after) for t, contact, before, after in answer["events"]],
        np.array(answer["t"]),
        np.array(answer["v"]),
        list(answer["names"]),
    )


def _load(value: Any) -> Any:
    return piecewise_linear(*zip(*value, strict=True)) if isinstance(value, list) else value


def _scene(data: dict[str, Any]) -> Scene:
    elements: list[Any] = []
    for b in data["bodies"]:
        if b["inertia"] is None:
            elements.append(Drive(b["name"], velocity=_load(b["velocity"])))
        else:
            elements.append(
                Body(b["name"], inertia=b["inertia"], velocity=b["velocity"], position=b.get("position", 0.0))
            )
    for c in data["contacts"]:
        law = DryFriction(c["mu_s"], c["mu_c"], dwell=c["tau"])
        elements.append(Contact(c["name"], c["a"], c["b"], law, normal=_load(c["normal"])))
    for s in data.get("springs", []):
        elements.append(Spring(s["a"], s["b"], stiffness=s["k"], damping=s["c"], rest=s.get("rest", 0.0)))
    for f in data.get("forces", []):
        elements.append(Force(f["body"], _load(f["load"])))
    return Scene(*elements)
