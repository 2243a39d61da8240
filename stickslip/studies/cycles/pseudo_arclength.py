"""Branches of limit cycles round folds: the parameter is unknown, too, and the arc along the branch is given.

With the coordinates z of the start, the period T and the parameter p, the cycles near one are the null vector of
``[dz(T)/dz - 1, dz/dT, dz(T)/dp]``, in the scales of the cycle. A step goes along it, and Newton's method comes back to
the branch across it (pseudo-arclength continuation: H. B. Keller 1977). At a fold the parameter turns: its part in the
tangent passes 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from stickslip.model.arrays import Array
from stickslip.simulation.result import SimulationError
from stickslip.studies.cycles.cycle import Cycle, cycle_of
from stickslip.studies.cycles.shooting import CycleError, Shot
from stickslip.studies.parameters import Parameter

_MOST_STEPS = 12  # steps of Newton's method back to the branch
_TURNED = 0.7  # cosine of the angle by which the tangent may turn in a step
_FAR = 0.5  # part of its step by which a corrected place may lie off the predicted one

# Errors which say that there is no cycle where one was looked for.
ERRORS = (CycleError, SimulationError, np.linalg.LinAlgError)

_SURE = 1e-2  # part of the tolerance below which no further step is taken
_AT_FOLD = 1e-9  # part of a step to which a fold is found


@dataclass(frozen=True)
class Place:
    """A cycle on an arc."""

    cycle: Cycle
    value: float  # of the parameter
    # direction of the branch, of length 1: start, period where it is free, parameter, each over its scale
    tangent: Array

    @property
    def pace(self) -> float:
        """How the parameter changes along the arc."""
        return float(self.tangent[-1])


class Arc:
    """Steps along a branch of cycles.

    `period` returns the period of the loads at a value of the parameter; None where it is free or does not change. A
    change of the parameter by `scale` is neither small nor large.
    """

    def __init__(self, parameter: Parameter, period: Callable[[float], float] | None, scale: float) -> None:
        self._parameter, self._period, self._scale = parameter, period, abs(scale)

    def begin(self, cycle: Cycle, value: float, forward: bool) -> Place:
        """Return the place of a cycle; along its tangent the parameter rises if `forward`, else it falls."""
        _, _, tangent = self._linear(cycle.shot, value)
        return Place(cycle, value, tangent if (tangent[-1] > 0) == forward else -tangent)

    def step(self, place: Place, length: float) -> Place:
        """Return the place that lies some length further along the arc."""
        shot, value = self._moved(place.cycle.shot, place.value, length * place.tangent)
        errors: list[float] = []
        best = shot, value
        for _ in range(_MOST_STEPS):
            errors.append(shot.error)
            if shot.error <= min(errors):
                best = shot, value
            elif min(errors) <= shot.tolerance:
                break
            if shot.error <= _SURE * shot.tolerance:
                break
            matrix, missed, _ = self._linear_near(place, shot, value)
            bordered = np.vstack([matrix, place.tangent])
            change = np.linalg.solve(bordered, np.append(-missed, 0.0))
            if np.abs(change).max() > _FAR * abs(length):
                raise CycleError("the branch bends too much for one step")
            shot, value = self._moved(shot, value, change)
        if min(errors) > shot.tolerance:
            raise CycleError("no cycle was found along the branch")
        shot, value = best
        _, _, tangent = self._linear_near(place, shot, value)
        along = float(tangent @ place.tangent)
        if abs(along) < _TURNED:
            raise CycleError("the branch bends too much for one step")
        return Place(cycle_of(shot), value, tangent if along > 0 else -tangent)

    def fold(self, before: Place, length: float) -> Place:
        """Return the place within a step where the parameter turns."""

        def pace(part: float) -> float:
            return self.step(before, part).pace if part else before.pace

        if before.pace * pace(length) > 0:
            raise CycleError("the parameter does not turn there")
        found = scipy.optimize.brentq(pace, 0.0, length, xtol=_AT_FOLD * abs(length))
        return self.step(before, float(found))

    def _linear_near(self, place: Place, shot: Shot, value: float) -> tuple[Array, Array, Array]:
        """Return what `_linear` does, of a shot that begins as the cycle of a place does."""
        found = self._linear(shot, value)
        if found[-1].size != place.tangent.size:
            raise CycleError("contacts stick or slip at the start of the cycle that did not before")
        return found

    def _linear(self, shot: Shot, value: float) -> tuple[Array, Array, Array]:
        """Return derivatives of `missed` by start, period and parameter, `missed`, and the tangent, all over scales."""
        by_parameter, _ = shot.by_parameter(self._parameter.at(value))
        if self._period is not None:
            h = 1e-4 * self._scale
            longer = (self._period(value + h) - self._period(value - h)) / (2 * h)
            by_parameter = by_parameter + shot.rate_after * longer
        matrix, missed = shot.matrix(by_parameter * self._scale), shot.lines(shot.missed)
        _, parts, lines = np.linalg.svd(matrix)
        if matrix.shape[0] and parts[-1] <= 1e-10 * parts[0]:
            raise CycleError("branches of cycles cross here")
        return matrix, missed, lines[-1]

    def _moved(self, shot: Shot, value: float, change: Array) -> tuple[Shot, float]:
        """Return the shot after a change of start, period and parameter in their scales."""
        count = shot.coordinates.size
        by = float(change[-1]) * self._scale
        if self._period is not None:
            longer = self._period(value + by) - shot.period
        else:
            longer = 0.0 if shot.forced else float(change[count]) * shot.period
        own = self._parameter.at(value)
        _, begin = shot.by_parameter(own)
        try:
            scene = own.set(shot.scene, value + by)
        except (ValueError, TypeError) as error:
            raise CycleError(f"the branch leaves the values that the parameter may have: {error}") from None
        y = shot.start + begin * by
        return shot.moved(change[:count] * shot.sizes, longer, scene, y), value + by
