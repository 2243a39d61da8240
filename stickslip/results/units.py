"""Units of quantities in a result: those of rotation, of translation, or both where the scene does not say which."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stickslip.model.elements import GROUND, Body, Drive, Force
from stickslip.model.elements.base import MotionKind, Radii
from stickslip.model.scene import Scene


@dataclass(frozen=True)
class Units:
    """SI units of a body's or a row's quantities."""

    # of rotation, of translation, or both beside each other
    inertia: str
    position: str
    velocity: str
    force: str
    stiffness: str
    damping: str

    @property
    def known(self) -> bool:
        """Whether they are those of one kind of motion."""
        return self is not _BOTH


_BOTH = Units("kg | kg m²", "m | rad", "m/s | rad/s", "N | N m", "N/m | N m/rad", "N s/m | N m s/rad")
_OF: dict[MotionKind | None, Units] = {
    "translation": Units("kg", "m", "m/s", "N", "N/m", "N s/m"),
    "rotation": Units("kg m²", "rad", "rad/s", "N m", "N m/rad", "N m s/rad"),
    None: _BOTH,
}


def units(scene: Scene, *elements: Any) -> Units:
    """Return the units that some elements of a scene share; both kinds beside each other where they differ.

    An element with radii is measured along a line, in m/s and N, unless all its bodies rotate and its radii are 1.
    A tie or a gear has the units of its first member whose coefficient is 1 or -1 (of a gear `a`, of a planetary the
    sun): its force is the force on that member.

    Without elements, they are the units of all bodies and drives.
    """
    motions = {_motion(scene, element) for element in elements or (*scene.bodies, *scene.drives)}
    return _OF[motions.pop()] if len(motions) == 1 else _BOTH


def units_of_body(scene: Scene, name: str) -> Units:
    """Return the units of a body or drive; for the ground those of all together."""
    return units(scene, *(one for one in (*scene.bodies, *scene.drives) if one.name == name))


def _motion(scene: Scene, element: Any) -> MotionKind | None:
    """Return the kind of motion in whose units an element's quantities are measured; None where it is not known."""
    if isinstance(element, (Body, Drive)):
        return scene.motions[element.name]
    if isinstance(element, Force):
        return scene.motions[element.body]
    members = {name: c for name, c in getattr(element, "coefficients", {}).items() if name != GROUND}
    if not isinstance(element, Radii):
        first = next((name for name, c in members.items() if abs(c) == 1), None)
        members = members if first is None else {first: 1.0}
    said = {scene.motions[name] for name in members}
    if said <= {None}:
        return None
    if "translation" in said or (isinstance(element, Radii) and element.radii != (1.0, 1.0)):
        return "translation"
    return None if None in said else "rotation"
