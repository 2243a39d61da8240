"""Newton's method for limit cycles: from a motion that nearly closes, and from a cycle to those next to it.

With the monodromy matrix ``M = dz(T)/dz(0)`` of the state z that closes after one period it solves

    z(T) = z(0)                              with a period given, and otherwise also   f . (z(0) - z_guess) = 0

where ``f = z'`` and T is unknown, too.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from stickslip.model.arrays import Array
from stickslip.simulation.result import SimulationError
from stickslip.simulation.simulate import compiled
from stickslip.studies.cycles.cycle import Cycle, centred, cycle_of
from stickslip.studies.cycles.periodicity import check_loads
from stickslip.studies.cycles.shooting import CycleError, Shot
from stickslip.studies.parameters import Parameter

# Most steps, and most lengths that are tried of each step. The search ends after _PATIENCE steps with little gain; next
# to a known cycle after _NEXT_TO_ONE, because the parameter can then be changed by less.
_MOST_STEPS, _MOST_TRIALS, _PATIENCE, _NEXT_TO_ONE = 25, 6, 4, 2

_SURE = 1e-4  # part of the tolerance below which no further step is taken

# A cycle that lies further from its prediction than both these parts, of its size and of the change, is another one.
_NEAR_BY, _FAR = 0.05, 0.5
_CAREFUL = 1e-3, 0.1  # the same where no step may lead to another branch, however near that is

# Parts by which a cycle is made smaller to find one just within it.
_INWARDS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)


def closed(shot: Shot, trials: int = _MOST_TRIALS, below: float = math.inf, patience: int = _PATIENCE) -> Cycle:
    """Return the cycle to which Newton's method leads from a shot, by motions with fewer events than `below`.

    At most `trials` lengths are tried of each step, and `patience` steps that gain little are taken.
    """
    tolerance = shot.tolerance
    best = shot
    errors: list[float] = []
    for _ in range(_MOST_STEPS):
        if errors and not shot.error < best.error and best.error <= tolerance:
            break
        best = shot if shot.error < best.error else best
        errors.append(best.error)
        stalls = len(errors) > patience and errors[-1] > 0.3 * errors[-1 - patience]
        if shot.error <= _SURE * shot.tolerance or stalls:
            break
        change, longer = shot.solve(-shot.missed)
        following = _nearer(shot, change, longer, trials, below)
        if following is None:
            break
        shot = following
    if best.error > tolerance:
        raise CycleError(
            f"no cycle was found: Newton's method comes to a standstill where the motion over {best.period:.6g} s "
            f"misses its start by {best.error:.2g} of its size; begin nearer to the cycle (transient=..., guess=...)"
        )
    return cycle_of(best)


def _nearer(shot: Shot, change: Array, longer: float, trials: int, below: float) -> Shot | None:
    """Return the shot after a step of Newton's method, shortened until it misses less; None where that fails."""
    part = 1.0
    if not shot.forced and abs(longer) > 0.5 * shot.period:
        part = 0.5 * shot.period / abs(longer)
    found: Shot | None = None
    for _ in range(trials):
        one: Shot | None = None
        with suppress(SimulationError, CycleError):
            one = shot.moved(part * change, part * longer)
        if one is None or len(one.result.events) >= below:
            part *= 0.5
            continue
        if found is None or one.error < found.error:
            found = one
        if one.error < shot.error:
            return one
        if shot.error <= 1e-9:
            return None
        part *= 0.5
    return found


def cycle_within(cycle: Cycle) -> Cycle | None:
    """Return a cycle just within one of free period that has lost a phase; None if there is none.

    Newton's method begins with motions of the same scene that are just so much smaller that they have lost a phase.
    """
    shot, coordinates = cycle.shot, cycle.shot.coordinates
    states = coordinates.of(cycle.result(np.linspace(0.0, cycle.period, 500)))
    inwards = np.zeros(coordinates.size)
    inwards[: states.shape[0]] = states.mean(axis=1) - coordinates.of(shot.start)
    for part in _INWARDS:
        smaller = shot.moved(part * inwards, 0.0)
        if len(smaller.result.events) >= len(cycle.sequence):
            continue
        try:
            found = centred(closed(smaller, below=len(cycle.sequence)))
        except (CycleError, SimulationError):
            continue
        if len(found.sequence) < len(cycle.sequence):
            return found
    return None


def closed_from(
    cycle: Cycle, parameter: Parameter, before: float, value: float, longer: float | None, carefully: bool = False
) -> Cycle:
    """Return the cycle near another one after a change of a parameter; `carefully`, only one close to the prediction.

    The parameter has changed from `before` to `value`, and the given period of the loads by `longer` in s, None if no
    period is given.
    """
    shot, change = cycle.shot, value - before
    given = 0.0 if longer is None else longer / change
    start_slope, slower, begin = shot.slopes_along_branch(parameter.at(before), given)
    scene = parameter.set(shot.scene, value)
    period = slower * change if longer is None else longer
    if shot.forced:
        check_loads(compiled(scene), shot.period + period)
    predicted = shot.moved(start_slope * change, period, scene, shot.start + begin * change)
    # if Newton's steps have to be shortened often, the parameter has changed too much
    found = closed(predicted, trials=2, patience=_NEXT_TO_ONE)
    off = _apart(found.shot, predicted)
    near_by, far = _CAREFUL if carefully else (_NEAR_BY, _FAR)
    if off > max(near_by, far * _apart(predicted, shot)):
        raise CycleError("the search leads to a cycle far from the one before")
    return found


def _apart(one: Shot, other: Shot) -> float:
    """Return by what part of their size two shots differ in start and period."""
    off = abs(one.period - other.period) / other.period
    if one.coordinates.free.size == other.coordinates.free.size:
        start = other.coordinates.of(one.start) - other.coordinates.of(other.start)
        off = max(off, float(np.abs(start / other.sizes[: start.size]).max(initial=0.0)))
    return off
