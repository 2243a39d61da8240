"""The modes that rows show: open ones after the motion to come, free ones after theirs, and all others their own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.guards import AT_LIMIT, ROUNDOFF
from stickslip.equations.mode_equations import AT_HIGH, FREE, OPEN
from stickslip.equations.motion import Motion

__all__ = ["label"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Modes = NDArray[np.int8]

_DIFFERENCED = 1e-6
_CALM = 1e-7
"""A relative acceleration this small, as a part of what the single forces would cause, is none."""


def label(motion: Motion, w: Array, resting: Mask, quiet: float, blur: float) -> Modes:
    """Return the modes that rows show.

    Parameters
    ----------
    motion : Motion
    w : array (m,)
        Relative velocities.
    resting : array (m,) of bool
        Rows whose relative velocity is 0.
    quiet : float
        Velocity in m/s or rad/s that the tolerances leave uncertain.
    blur : float
        Part of the forces that is uncertain.
    """
    modes = motion.equations.modes
    if modes.max(initial=0) < OPEN:
        return modes
    is_open = modes == OPEN
    named = np.sign(w)
    if (is_open & (resting | (np.abs(w) <= quiet))).any():
        named = _to_come(motion, w, resting, quiet, blur)
    shown = np.where(is_open, named, np.where(modes >= AT_HIGH, 0, modes))
    return np.where(modes == FREE, motion.system.sign_of(w), shown).astype(np.int8)


def _to_come(motion: Motion, w: Array, resting: Mask, quiet: float, blur: float) -> Array:
    """Return the signs of relative velocities, or where these are 0 of what they become."""
    m = motion.system.m
    start, horizon = motion.start, max(motion.horizon, np.finfo(float).tiny)
    magnitude = _magnitudes(motion)
    uncertain = [max(blur, ROUNDOFF), ROUNDOFF if motion.is_linear else _DIFFERENCED]
    to_come, rise, push = np.zeros(m), np.zeros(m), np.zeros(m)
    for k in (1, 2):
        term = start.z[k, :m]
        significant = np.abs(term) > uncertain[k - 1] * magnitude[k]
        to_come = np.where((to_come == 0) & significant, np.sign(term), to_come)
        rise += np.abs(term) * horizon ** (k - 1)
        push += magnitude[k] * horizon ** (k - 1)
    named = np.where(resting, to_come, np.sign(w))
    # what the solver's errors leave of a rest is a rest
    calm = (rise <= _CALM * push) | (rise * horizon <= quiet)
    named[calm & (np.abs(w) <= quiet)] = 0.0
    return named


def _magnitudes(motion: Motion) -> Array:
    """Return what adds up in the Taylor coefficients of the relative velocities, orders 0 to 2."""
    equations, m = motion.equations, motion.system.m
    y = np.abs(motion.start.y[0])
    found = np.zeros((3, m))
    for k in range(3):
        q = motion.start.q[k]
        q = np.zeros_like(motion.start.q[0]) if q is None else np.abs(q)
        rate, z = equations.magnitudes(y, q)
        found[k] = z[:m]
        y = rate / (k + 1)
    return found


_ = AT_LIMIT
