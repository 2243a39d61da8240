"""Functions by which many tests read a result, and the scene that many of them simulate."""

from __future__ import annotations

from stickslip import GROUND, Body, Contact, DryFriction, Force, Result, Scene, Signal

LAW = DryFriction(mu_static=0.5, mu_coulomb=0.4)


def block(
    load: Signal | float = 0.0, normal: Signal | float = 10.0, law: DryFriction = LAW, velocity: float = 0.0
) -> Scene:
    """A body of 1 kg on the ground: it holds 5 N and slides at 4 N."""
    return Scene(
        Body("a", inertia=1.0, velocity=velocity),
        Contact("c", "a", GROUND, law, normal=normal),
        Force("a", load),
    )


def told(result: Result) -> list[tuple[str, int, int]]:
    """Return which rows changed their modes, and how."""
    return [(e.contact, int(e.before), int(e.after)) for e in result.events]


def times(result: Result) -> list[float]:
    """Return the times of all events."""
    return [e.t for e in result.events]
