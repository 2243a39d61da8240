"""The arguments of `simulate`, checked before anything runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.model.checks import finite
from stickslip.model.laws.regularized import Dahl, Karnopp, LuGre
from stickslip.model.scene import Scene
from stickslip.model.signal_makers import as_signal

__all__ = [
    "FIXED",
    "between",
    "check_bristles",
    "check_dead_bands",
    "choice",
    "margin",
    "outputs",
    "span",
    "step_length",
]

FIXED = ("RK4", "Euler")
"""Methods with fixed steps."""


def span(t_span: Sequence[float]) -> tuple[float, float]:
    """Return start and end of a time span that runs forward."""
    try:
        start, stop = t_span
    except (TypeError, ValueError):
        raise ValueError(f"simulate: t_span must be two times (start, end), got {t_span!r}") from None
    start, stop = finite(start, "simulate: t_span"), finite(stop, "simulate: t_span")
    if not start < stop:
        raise ValueError(f"simulate: t_span must run forward, got ({start:g}, {stop:g}); swap the two times")
    return start, stop


def choice(name: str, value: Any, known: Sequence[str]) -> None:
    """Refuse an option that is not among the known ones."""
    if value not in known:
        raise ValueError(f"simulate: unknown {name} {value!r}; choose from {', '.join(map(repr, known))}")


def between(name: str, value: float, low: float, high: float) -> float:
    """Return a number that lies between two others."""
    number = finite(value, f"simulate: {name}")
    if not low < number < high:
        raise ValueError(f"simulate: {name} must lie between {low:g} and {high:g}, got {number:g}")
    return number


def margin(velocity_margin: float | None) -> float | None:
    """Return the velocity margin, None for the default."""
    if velocity_margin is not None and finite(velocity_margin, "simulate: velocity_margin") < 0:
        raise ValueError(f"simulate: velocity_margin must not be negative, got {velocity_margin:g}")
    return velocity_margin


def step_length(method: str, step: float | None, formulation: str) -> float | None:
    """Return the step of a fixed-step method, None for the others."""
    if method not in FIXED:
        if step is not None:
            raise ValueError(
                f"simulate: step={step!r} belongs to the methods RK4 and Euler; leave it out for {method}"
            )
        return None
    if step is None:
        raise ValueError(f"simulate: method {method!r} needs step=, the length of its steps in s")
    if formulation != "contact-force":
        raise ValueError(f"simulate: fixed steps solve the contact-force formulation, not {formulation!r}")
    return between("step", step, 0.0, math.inf)


def check_dead_bands(scene: Scene) -> None:
    """Refuse Karnopp's law between two bodies that can both move."""
    free = {body.name for body in scene.bodies}
    for contact in scene.contacts:
        if isinstance(contact.law, Karnopp) and contact.a in free and contact.b in free:
            raise ValueError(
                f"{contact.label}: Karnopp's dead band sets a velocity to that of the ground or a drive, but both "
                f"{contact.a!r} and {contact.b!r} can move, and momentum would not be conserved; use DryFriction"
            )


def check_bristles(scene: Scene, start: float, stop: float) -> None:
    """Refuse bristles that are pressed from nothing on a ramp: they are infinitely stiff at its foot."""
    for contact in scene.contacts:
        if not isinstance(contact.law, (LuGre, Dahl)):
            continue
        normal = as_signal(contact.normal, contact.label).clipped(start, stop)
        times = [start, *normal.breaks(start, stop)]
        foot = next((t for t in times if normal(t) == 0 and normal.slope(t) > 0), None)
        if foot is not None:
            raise ValueError(
                f"{contact.label}: its normal force rises from 0 at t = {foot:g}, where a bristle is infinitely stiff; "
                "let it start above 0, or use DryFriction"
            )


def outputs(
    t_eval: Iterable[float] | None, start: float, stop: float, dense: bool
) -> NDArray[np.float64] | None:
    """Return the output times, None for every computed point."""
    if t_eval is None:
        if not dense:
            raise ValueError("simulate: dense_output=False keeps nothing but the outputs; give t_eval")
        return None
    try:
        times = np.array(t_eval if isinstance(t_eval, np.ndarray) else list(t_eval), dtype=float)
    except (TypeError, ValueError):
        raise TypeError(f"simulate: t_eval must be a sequence of times, got {t_eval!r}") from None
    good = times.ndim == 1 and (times.size == 0 or (times[0] >= start and times[-1] <= stop))
    if not good or not (times[1:] > times[:-1]).all():
        raise ValueError(
            f"simulate: t_eval must be times that increase within [{start:g}, {stop:g}] s; sort and cut it"
        )
    return times
