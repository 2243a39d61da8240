"""How contacts without a mode of their own are named: open ones after the motion to come, free ones after theirs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from stickslip.mode_set import FREE, OPEN
from stickslip.segment import Segment

__all__ = ["label"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Modes = NDArray[np.int8]

_ROUNDOFF, _DIFFERENCED = 1e-12, 1e-9
_CALM = 1e-7
"""A relative acceleration this small, as a part of what the single forces would cause, is none."""


def label(segment: Segment, w: Array, resting: Mask, before: Modes | None) -> Modes:
    """Name the modes of open contacts, the sign of w or of the relative acceleration to come, and of free ones.

    What dies away is never at rest: it keeps the mode that it had `before`, unless others hold its ends together.
    """
    system, mode_set = segment.system, segment.mode_set
    at_rest = resting | (np.abs(w) <= system.quiet)
    named = np.sign(w)
    if at_rest[mode_set.open].any():
        named = _to_come(segment, w, resting, before)
    modes = np.where(mode_set.modes == OPEN, named, mode_set.modes)
    return np.where(modes == FREE, system.sign_of(w), modes).astype(np.int8)


def _to_come(segment: Segment, w: Array, resting: Mask, before: Modes | None) -> Array:
    """Return the signs of relative velocities, or where these are 0 of what they become."""
    system, horizon = segment.system, segment.horizon
    # what the forces that add up to an acceleration leave uncertain, now and on the way
    y, q = np.abs(segment.y), np.abs(segment.inputs(0.0))
    push = _push(segment, np.concatenate([y, q]))
    later = _push(
        segment, np.concatenate([y + horizon * np.abs(segment.f0), q + horizon * np.abs(segment.q1)])
    )
    to_come, rise = np.zeros(system.m), np.zeros(system.m)
    for term, uncertain in _accelerations(segment, push, later):
        to_come = np.where((to_come == 0) & (np.abs(term) > uncertain), np.sign(term), to_come)
        rise += np.abs(term)
    named = np.where(resting, to_come, np.sign(w))
    # what the solver's errors leave of a rest is a rest, what they leave of a motion is that motion
    calm = (rise <= _CALM * later) | (rise * horizon <= system.quiet)
    calm &= np.abs(w) <= system.quiet
    if before is None:
        named[calm & resting] = 0.0
    else:
        named[calm] = before[calm]
    named[segment.mode_set.held_together] = 0.0
    return named


def _accelerations(segment: Segment, push: Array, later: Array) -> Iterator[tuple[Array, Array]]:
    """Yield what relative accelerations are at the start, and become by their rates, each with its uncertainty."""
    W, horizon = segment.system.W, segment.horizon
    yield W @ segment.f0 + segment.system.D @ segment.drive_acceleration(0.0), segment.system.blur * push
    if segment.curved_rates:
        rate = segment.second_rate(0.0, segment.y, segment.f0)
        yield horizon * (W @ rate), _DIFFERENCED * later
    else:
        yield horizon * (W @ segment.f1), _ROUNDOFF * later
        yield 0.5 * horizon**2 * (W @ segment.expansion.bends), _ROUNDOFF * later


def _push(segment: Segment, magnitudes: Array) -> Array:
    """Return the relative accelerations that single forces would cause, from absolute values of states and inputs."""
    system, groups = segment.system, segment.mode_set.groups
    forces = system.magnitudes @ magnitudes
    single = np.maximum(forces / system.inertia, groups.totals(forces) / groups.mass)
    return system.at_ends(single)
