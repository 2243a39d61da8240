"""The modes that rows show: open rows by the motion to come, free ones by their velocity, all others their own."""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.equations.guards.at_start import AT_LIMIT, DIFFERENCED, HIGHEST, ROUNDOFF, with_time
from stickslip.equations.mode_equations import OPEN
from stickslip.equations.motion import Motion
from stickslip.events.situation import Uncertainty
from stickslip.model.arrays import Array, Mask, Modes
from stickslip.model.slopes import SLOPES_STEP

# A relative acceleration this small, as a part of what the single forces would cause, is none.
_CALM, _CALM_IF_EXACT = 1e-7, 1e-11


def label(
    motion: Motion,
    named: Array | Modes,
    w: Array,
    resting: Mask,
    before: Modes | None,
    crossed: Mask,
    uncertainty: Uncertainty,
) -> tuple[Modes, Mask]:
    """Return the modes that rows show, and which open rows keep theirs though their velocity has died away.

    `named` are the signs of the relative velocities `w`, `before` the modes shown so far, None at the start. Where a
    velocity has `crossed` 0 by more than is uncertain, it has not died away.
    """
    equations, modes = motion.equations, motion.equations.modes
    if not (equations.open.size or equations.free.size or equations.at_level.size):
        return modes, np.zeros(modes.size, dtype=bool)
    is_open, died = modes == OPEN, np.zeros(modes.size, dtype=bool)
    # a row that rested still rests if only the solver's errors move it; a row whose velocity dies away does not rest
    may_rest = resting | (
        (np.abs(w) <= uncertainty.velocity_resolution) & (before == 0 if before is not None else True)
    )
    if np.count_nonzero(is_open & may_rest):
        sign = np.zeros(w.size, dtype=np.int8) if before is None else before
        named, died = _to_come(motion, named, w, resting, may_rest & (sign == 0), sign, crossed, uncertainty)
    shown = np.where(is_open, named, modes).astype(np.int8)
    shown[equations.at_level] = 0
    if equations.free.size:
        shown[equations.free] = motion.system.sign_of(w)[equations.free]
    return shown, died & is_open


def _to_come(
    motion: Motion,
    named: Array | Modes,
    w: Array,
    resting: Mask,
    may_rest: Mask,
    before: Modes,
    crossed: Mask,
    uncertainty: Uncertainty,
) -> tuple[Array | Modes, Mask]:
    """Return the signs of relative velocities, where these are 0 those to come, and which velocities have died away."""
    is_open = motion.equations.modes == OPEN
    slow = uncertainty.velocity_resolution
    uncertain = np.where(crossed, ROUNDOFF, max(uncertainty.force_uncertainty, ROUNDOFF))
    still = _CALM_IF_EXACT if uncertainty.velocity_uncertainty is None else _CALM
    to_come, calm = _first_terms(motion, 2, slow, uncertain, still)
    if motion.is_linear and np.any(is_open & resting & (to_come == 0)):
        # orders that only springs and oscillating loads have
        to_come, calm = _first_terms(motion, HIGHEST, slow, uncertain, still)
    calm &= ~crossed
    # a velocity that has died away keeps its sign, unless held rows lock the row or let it move only as drives do
    free = ~motion.equations.locked(slice(None), ignore_drives=True)
    died = ((to_come == 0) | calm) & resting & (before != 0) & free
    named = np.where(resting, np.where(died, before, to_come), named)
    named[calm & may_rest & (np.abs(w) <= slow)] = 0.0
    return named, died


def _first_terms(motion: Motion, order: int, slow: Array, uncertain: Array, still: float) -> tuple[Array, Mask]:
    """Return the sign of each row's first Taylor coefficient that is more than roundoff, and which rows hardly move."""
    m = motion.system.m
    expansion = motion.start if order == 2 else motion.expand(0.0, motion.y, order)
    sizes = np.array([z[:m] for _, z in motion.majorants(order + 1)])
    magnitude, horizon = with_time(sizes, sizes, motion.t), max(motion.horizon, np.finfo(float).tiny)
    to_come, rise, push = np.zeros(m), np.zeros(m), np.zeros(m)
    for k in range(1, order + 1):
        term = expansion.z[k, :m]
        part: Any = uncertain if k == 1 else ROUNDOFF if k == 2 else 10 * AT_LIMIT
        if k > 1 and not motion.is_linear:
            part = DIFFERENCED
        rough = 0.0 if motion.roughness is None else motion.roughness[1][1][:m] / SLOPES_STEP ** (k - 1)
        significant = np.abs(term) > part * magnitude[k] + rough
        to_come = np.where((to_come == 0) & significant, np.sign(term), to_come)
        rise += np.abs(term) * horizon ** (k - 1)
        push += magnitude[k] * horizon ** (k - 1)
    calm = rise <= still * push
    # slopes at the start do not tell what a function of time does later
    return to_come, calm if motion.segment.has_functions else calm | (rise * horizon <= slow)
