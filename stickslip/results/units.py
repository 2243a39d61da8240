"""Units of what a result holds: those of rotation, of translation, or both where the scene does not say which."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stickslip.model.scene import Scene

__all__ = ["Units", "units"]


@dataclass(frozen=True)
class Units:
    """SI units of a body's or a row's quantities.

    Attributes
    ----------
    inertia, position, velocity, force, stiffness, damping : str
        Of rotation, of translation, or both beside each other.
    """

    inertia: str
    position: str
    velocity: str
    force: str
    stiffness: str
    damping: str


_TRANSLATION = Units("kg", "m", "m/s", "N", "N/m", "N s/m")
_ROTATION = Units("kg m²", "rad", "rad/s", "N m", "N m/rad", "N m s/rad")
_BOTH = Units("kg | kg m²", "m | rad", "m/s | rad/s", "N | N m", "N/m | N m/rad", "N s/m | N m s/rad")


def units(scene: Scene, element: Any = None) -> Units:
    """Return the units of a scene's bodies, or those of one of its elements.

    Radii turn rad/s into m/s: what joins two bodies at radii is measured in m/s and N, also where the scene rotates.

    Parameters
    ----------
    scene : Scene
    element : Element, optional
        A contact, spring or another element that joins bodies.
    """
    if scene.motion is None:
        return _BOTH
    radii = (getattr(element, "radius_a", 1.0), getattr(element, "radius_b", 1.0))
    return _ROTATION if scene.motion == "rotation" and radii == (1.0, 1.0) else _TRANSLATION
