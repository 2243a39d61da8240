"""One period of a motion from a start, by how much it misses this start, and the derivatives of that: shooting."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Complex
from stickslip.model.scene import Scene
from stickslip.simulation.simulate import compiled
from stickslip.studies.cycles.periodicity import (
    Closing,
    Coordinates,
    middle_of,
    movable,
    position_size,
    read_positions,
    scene_at,
    started,
)
from stickslip.studies.derivatives.directions import along_parameter
from stickslip.studies.derivatives.variations import Variation, simulated
from stickslip.studies.parameters import Parameter

# A motion closes if it misses its start by no more than this part of its size; a motion by CVODE may miss it by a
# thousand times as much.
_CLOSED = 1e-10

_ZERO = 1e-9  # a multiplier no larger than this is 0
_FORGOTTEN = 1e-10  # singular values of the map over one period below this part of the largest are 0

# Singular values below this part of the largest entry of the map over one period are roundoff.
_ROUNDOFF = 1e-13


class CycleError(RuntimeError):
    """No limit cycle was found; the message says why."""


class Shot:
    """One period of a motion from a scene's start, and by how much it misses its start.

    It starts at the time `begin` in s; if it is `forced`, the period is given.
    """

    def __init__(self, scene: Scene, period: float, forced: bool, options: dict[str, Any], begin: float = 0.0) -> None:
        self.scene, self.period, self.forced, self.options = scene, period, forced, options
        self.begin = begin
        self._by_parameter: dict[str, tuple[Array, Array]] = {}
        self.result = simulated(scene, (begin, begin + period), **options)
        trajectory = self.result.trajectory
        self.system: System = trajectory.system
        first = trajectory.pieces[0]
        self.coordinates = Coordinates(self.system, trajectory.motion(0), first.labels)
        last = trajectory.pieces[-1]
        self.start, self.stop = first.y, last.kept_path.last
        aged = self.coordinates.aged
        self.ages = begin - first.since[aged]
        ages_after = begin + period - last.since[aged]
        before, after = self.coordinates.of(self.start), self.coordinates.of(self.stop)
        self.missed = np.concatenate([after - before, ages_after - self.ages])
        self.sizes = self.coordinates.sizes(self.result)
        self.error = max(float(np.abs(self.missed / self.sizes).max(initial=0.0)), self._elsewhere)

    @property
    def tolerance(self) -> float:
        """The error up to which it counts as closed."""
        return _CLOSED if self.result.stats["engine"] == "Taylor series" else 1e3 * _CLOSED

    @property
    def _elsewhere(self) -> float:
        """By what part of its size the motion misses its start in all states that have to close.

        Those that are held at the start are no coordinates, but may move at the end.
        """
        closing = Closing(self.system)
        off = np.abs(closing.of(self.stop) - closing.of(self.start))
        whole = closing.of(self.result.y)
        speeds, places = closing.groups
        sizes = (
            max(float(np.ptp(whole[speeds], axis=1).max(initial=0.0)), 1e-300),
            position_size(self.system, self.result, whole[places]),
        )
        return max(float(off[g].max(initial=0.0)) / size for g, size in zip(closing.groups, sizes, strict=True))

    def between_events(self) -> Shot:
        """Return the shot from the middle of the longest motion: an event at the start would have no derivative."""
        at = middle_of(self.result, self.begin, self.begin + self.period)
        begin = at % self.period if self.forced else 0.0
        return Shot(scene_at(self.result, at), self.period, self.forced, self.options, begin)

    @property
    def starts_within(self) -> bool:
        """Whether a cycle starts within its longest motion, at least a quarter of this away from its ends."""
        pieces = self.result.trajectory.pieces
        first, last = pieces[0], pieces[-1]
        alike = np.array_equal(first.labels, last.labels) and np.array_equal(first.modes, last.modes)
        if not alike or (self.forced and not self.begin):
            # there is an event at the start, or a load may break there
            return False
        after, before = first.stop - first.t, last.stop - last.t
        others = max((one.stop - one.t for one in pieces[1:-1]), default=0.0)
        return 4 * min(after, before) >= after + before >= others

    def _after(self, variation: Variation) -> Array:
        """Return how the coordinates at the end change in each direction."""
        aged = self.coordinates.aged
        last = self.result.trajectory.pieces[-1]
        end = variation.pieces[-1].at(np.array([last.end]))[:, 0]
        found = np.concatenate([self.coordinates.of(end), -variation.pieces[-1].since_change[aged]])
        if np.isnan(found).any():
            t, _, why = variation.reasons[0] if variation.reasons else (0.0, 0, "unknown")
            raise CycleError(f"the map over one period has no derivative: at t = {t:.9g} s {why}")
        return found

    @cached_property
    def monodromy(self) -> Array:
        """Derivatives of the coordinates after one period by those before."""
        return self._after(Variation(self.result, self.coordinates.directions()))

    def _rate(self, number: int, tau: float, y: Array) -> Array:
        """Return the rates of the coordinates in a state at a local time of a piece."""
        motion = self.result.trajectory.motion(number)
        return np.concatenate([self.coordinates.of(motion.rate(tau, y)), np.ones(self.coordinates.aged.size)])

    @cached_property
    def rate_before(self) -> Array:
        """Rates of the coordinates at the start."""
        return self._rate(0, 0.0, self.start)

    @cached_property
    def rate_after(self) -> Array:
        """Rates of the coordinates at the end."""
        pieces = self.result.trajectory.pieces
        return self._rate(len(pieces) - 1, pieces[-1].end, self.stop)

    def matrix(self, *others: Array) -> Array:
        """Return the derivatives of `missed` by start, free period and `others`, all in units of their sizes.

        Where the period is free, the last line gives how far a change of the start goes along the motion itself.
        """
        count = self.coordinates.size
        columns = [(self.monodromy - np.eye(count)) * self.sizes]
        if not self.forced:
            columns.append((self.rate_after * self.period)[:, None])
        found = np.hstack([*columns, *(one[:, None] for one in others)]) / self.sizes[:, None]
        if self.forced:
            return found
        along = np.zeros((1, found.shape[1]))
        along[0, :count] = self.rate_before / self.sizes * self.period
        return np.vstack([found, along])

    def lines(self, missed: Array) -> Array:
        """Return `missed` in units of its sizes, a number for each line of `matrix`."""
        found = missed / self.sizes
        return found if self.forced else np.append(found, 0.0)

    def solve(self, right: Array) -> tuple[Array, float]:
        """Return changes of start and period that change `missed` by `right`.

        If there are none, cycles are not single there, or there is no cycle: that is a `CycleError`.
        """
        sizes, count = self.sizes, self.coordinates.size
        matrix, sought = self.matrix(), self.lines(right)
        if not count:
            return np.zeros(0), 0.0
        # a singular value that is roundoff of the monodromy matrix is no slope
        left, parts, right_vectors = np.linalg.svd(matrix)
        sure = parts > _ROUNDOFF * max(1.0, float(np.abs(self.monodromy * sizes / sizes[:, None]).max()))
        found = right_vectors.T @ np.divide(left.T @ sought, parts, out=np.zeros(parts.size), where=sure)
        if not np.allclose(matrix @ found, sought, rtol=1e-6, atol=1e-9 * (1 + np.abs(sought).max(initial=0.0))):
            raise CycleError(
                "a multiplier is 1: cycles are no longer single there (a fold, or a family of them), or a load is "
                "in resonance and there is none"
            )
        return found[:count] * sizes, 0.0 if self.forced else float(found[count] * self.period)

    def moved(self, change: Array, longer: float, own: Scene | None = None, y: Array | None = None) -> Shot:
        """Return the shot from another start, with another period."""
        if abs(longer) > 0.6 * self.period:
            raise CycleError("the period changes too much for one step")
        states = self.coordinates.to_states
        count = states.shape[1]
        y = (self.start if y is None else y) + states @ change[:count]
        ages = np.maximum(self.ages + change[count:], 0.0)
        modes = self.result.trajectory.pieces[0].modes
        if own is None:
            own = self.scene
        else:
            # the start comes from derivatives, which leave roundoff in the velocities of held rows
            system = compiled(own)
            q = system.loads(self.begin, self.begin + self.period).after(self.begin).at(self.begin)
            y = system.with_held(y, system.drive_velocities(q), (modes == 0) & system.hard)
        try:
            scene = started(own, self.system, y, self.coordinates.aged, ages, modes)
            return Shot(scene, self.period + longer, self.forced, self.options, self.begin)
        except ValueError as error:
            raise CycleError(f"the search leads to where the scene cannot be: {error}") from None

    def by_parameter(self, parameter: Parameter) -> tuple[Array, Array]:
        """Return the derivatives of `missed`, and of the starting state, by a parameter."""
        if parameter.name not in self._by_parameter:
            direction = along_parameter(self.scene, parameter, self.result.trajectory, "limit_cycle")
            variation = Variation(self.result, [direction])
            begin = variation.pieces[0].at(np.zeros(1))[:, 0]
            aged = self.coordinates.aged
            before = np.concatenate([self.coordinates.of(begin), -variation.pieces[0].since_change[aged]])
            found = (self._after(variation) - before)[:, 0], begin[:, 0]
            self._by_parameter[parameter.name] = found
        return self._by_parameter[parameter.name]

    def slopes_along_branch(self, parameter: Parameter, given: float = 0.0) -> tuple[Array, float, Array]:
        """Return the derivatives of start and period by a parameter along the cycles, and that of the starting state.

        `given` is the derivative of the given period of the loads.
        """
        by_parameter, begin = self.by_parameter(parameter)
        change, longer = self.solve(-by_parameter - self.rate_after * given)
        return change, longer, begin

    def multipliers(self) -> Complex:
        """Return the eigenvalues of the map over one period, without that along the motion if the period is free."""
        matrix = self.monodromy * self.sizes / self.sizes[:, None]
        # the number of multipliers that are not 0: what held rows forget on the way is lost, but for a solver's errors
        rank = np.linalg.matrix_rank(matrix, tol=_FORGOTTEN * np.linalg.norm(matrix, 2)) if matrix.size else 0
        if not self.forced:
            f = self.rate_before / self.sizes
            if np.linalg.norm(f) == 0:
                raise CycleError("nothing moves at the start of the cycle")
            whole = np.linalg.qr(np.column_stack([f, np.eye(f.size)]))[0]
            across = whole[:, 1 : f.size]
            matrix = across.T @ matrix @ across
        found = np.linalg.eigvals(matrix).astype(complex) if matrix.size else np.zeros(0, dtype=complex)
        found[np.abs(found) <= _ZERO] = 0.0
        found = found[np.argsort(-np.abs(found), kind="stable")]
        found[max(int(rank) - (not self.forced), 0) :] = 0.0
        # rows held at the start leave fewer coordinates: each missing one has the multiplier 0
        system = self.system
        ties = np.linalg.matrix_rank(dense(system.G)[system.is_tie]) if system.is_tie.any() else 0
        places = movable(system, read_positions(system), np.zeros(system.m, dtype=bool)).shape[0]
        count = system.n - int(ties) + places + system.size - system.first_bristle - (not self.forced)
        return np.concatenate([found, np.zeros(max(count - found.size, 0), dtype=complex)])[:count]
