"""The guards of one motion: their slopes along it, their changes, and how the time of its end changes."""

from __future__ import annotations

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.guards.guards import Guards
from stickslip.equations.guards.values import GuardValues
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.model.arrays import Array, Indices, Mask
from stickslip.results.pieces import Piece
from stickslip.studies.derivatives.nearby import Nearby
from stickslip.studies.derivatives.steep import brought_to_rest

TIE = 1e-6  # derivatives that differ by less than this part of their size count as equal

# A guard grazes 0 if its slope is below this part of the terms that add up in the slope. It does not if it has fallen
# at about this slope ever since it was last clearly positive.
_GRAZING_SLOPE = 1e-7

_ABOUT = 0.1  # a guard that falls faster than this part of its slope when it left 0 comes back about as fast
_CLEARLY_POSITIVE = 1e-9  # part of its size above which a guard is clearly positive, even if CVODE has computed it
_HALVINGS = 40  # how often the time before the end is halved to find where a guard was last clearly positive

# Where rebounds accumulate, flights slower than this part of the speeds of the whole motion are so short that the
# derivative of their duration is roundoff.
_SHORT = 1e-9

_PARALLEL = 1e-12  # part of its coefficients by which a row may differ from a multiple of another one
_TIE_OF_ENGINES = 1e-13  # guards within this part of their scales come to 0 together for the engines


class VariedGuards:
    """The guards of a motion, and of the motions near by.

    The motion is that of the piece, or another one in its modes.
    """

    def __init__(self, nearby: Nearby, piece: Piece, motion: Motion) -> None:
        self._nearby, self._piece, self._motion = nearby, piece, motion
        rest = nearby.at_rest(motion) & ~motion.equations.is_held
        self.guards = Guards(motion, piece.labels, rest, np.zeros(nearby.system.m, dtype=bool))

    def raw(self, own: Motion, taus: Array, states: Array) -> Array:
        """Return the guards of the motion, or of one near by, as a quantity in the sense of `OfMotion`."""
        guards: GuardValues = self.guards
        if own is not self._motion:
            guards = GuardValues(own, self._piece.labels, guards.at_rest, self.guards.in_band)
        return guards.raw(own.watched(taus, states), own.inputs(taus, states))

    def label(self, i: int) -> str:
        """Return the name of the row, or of the piecewise-linear function, that a guard belongs to."""
        if not self.guards.is_border[i]:
            return repr(self._nearby.system.rows[int(self.guards.row[i])].name)
        functions = self._nearby.system.piecewise
        return str(functions.labels[functions.owner[self._border(i)]])

    def is_continuous(self, i: int) -> bool:
        """Tell whether a guard is a border at which the force only has a corner: touching it changes nothing."""
        functions = self._nearby.system.piecewise
        return bool(self.guards.is_border[i]) and not functions.is_stop[functions.owner[self._border(i)]]

    def _border(self, i: int) -> int:
        """Return the border that a guard watches, among those of all functions."""
        return int(self._motion.equations.borders[np.count_nonzero(self.guards.is_border[:i])])

    def sizes(self, path: Path) -> tuple[Array, Array]:
        """Return the sizes of the terms that add up in guards and their slopes; of borders along the whole path."""
        guards, system = self.guards, self._nearby.system
        _, size = guards.at_end(path)
        slopes = guards.majorant[1]
        if guards.is_border.any():
            equations = self._motion.equations
            largest, q = path.largest, np.abs(self._motion.start_inputs)
            pace = np.abs(self._motion.rate(float(path.taus[-1]), path.last))
            pace[system.moved_state] = largest[system.moved]
            size, slopes = size.copy(), slopes.copy()
            size[guards.is_border] = equations.border_majorants(largest, q)
            slopes[guards.is_border] = equations.border_majorants(pace, np.zeros_like(q))
        return size, slopes

    def moving(self, some: Indices, slopes: Array) -> list[tuple[int, int]]:
        """Return guards among some, and directions that move them by more than roundoff."""
        largest = np.maximum(self.guards.scale, self.guards.majorant[0])[some, None]
        roundoff = TIE * largest / self._nearby.sizes
        found = np.argwhere(np.abs(slopes[some]) > roundoff)
        return [(int(some[i]), int(k)) for i, k in found]

    def moved(self, some: Indices, tau: float, y: Array, S: Array, since: Array, times: Array) -> list[tuple[int, int]]:
        """Return `moving` guards and directions at a local time that changes by `times`; S are the variations there."""
        if not some.size:
            return []
        slopes = self._nearby.slopes_at(self.raw, self._motion, since, tau, y, S)
        return self.moving(some, slopes + np.outer(self.falls(tau, y), times))

    def end(self, tau: float, S: Array, since: Array, begin: Array) -> tuple[Array, dict[int, str]]:
        """Return how the time changes at which guards come to 0, ``-(g_p + g_y S) / g'``, or why it has no derivative.

        The time at which the motion begins changes by `begin`.
        """
        path, count = self._piece.kept_path, self._nearby.count
        y = path.last
        values = self.guards.values(tau, y)
        size, slopes = self.sizes(path)
        part = values / np.where(size > 0, size, 1.0)
        fired = (part <= max(0.0, float(part.min(initial=np.inf))) + _TIE_OF_ENGINES).nonzero()[0]
        if not fired.size:
            return np.full(count, np.nan), dict.fromkeys(
                range(count), "the motion ends in a way that has no derivative here"
            )
        is_linear = bool(self._is_linear[fired].all())
        moved = self._nearby.slopes_at(self.raw, self._motion, since, tau, y, S, is_linear)[fired]
        moved = self._with_stops(moved, fired, y, S, self._motion.loads(tau))
        passing = self.guards.passing
        stopped = np.array([self.guards.row[i] for i in fired.tolist() if i in passing], dtype=np.intp)
        if stopped.size and not self._motion.is_linear:
            y = brought_to_rest(self._motion, stopped, tau, y)
        falls = self.falls(tau, y)[fired]
        weights = self._of_one_motion(fired)
        if weights is not None and abs(weights @ falls) > _GRAZING_SLOPE * (weights @ slopes[fired]):
            # near by their shares of the force differ: they let go where its sum comes to the sum of their levels
            return -(weights @ moved) / (weights @ falls), {}
        # `slopes` are sizes at the start of the motion: where one is 0 there, its guard falls later and does not graze
        with np.errstate(divide="ignore", invalid="ignore"):
            steep = np.nan_to_num(np.abs(falls) / slopes[fired], posinf=np.inf)
        # of guards that come to 0 together, the steepest one gives the time
        first = int(np.argmax(steep))
        names = sorted({self.label(int(i)) for i in fired})
        i, fall = int(fired[first]), float(falls[first])
        rebound = self._flies(i, tau, abs(fall))
        if rebound <= _SHORT:
            return begin.copy(), {}
        grazes = steep[first] <= _GRAZING_SLOPE < rebound
        if grazes and not (self._comes_back(i, fall) or self._comes_down(i, size, fall)):
            why = f"{names[0]} grazes: its guard comes to 0 with slope 0"
            return np.full(count, np.nan), dict.fromkeys(range(count), why)
        times = -moved[first] / fall
        off = np.abs(moved + falls[:, None] * times)
        limit = TIE * (np.abs(moved) + np.abs(falls[:, None] * times)) + 1e-9 * size[fired][:, None]
        apart = (off > limit).any(axis=0)
        times[apart] = np.nan
        why = f"events of {' and '.join(names)} fall together"
        return np.asarray(times), dict.fromkeys(apart.nonzero()[0].tolist(), why)

    def _of_one_motion(self, fired: Indices) -> Array | None:
        """Return the weights of held contacts that hold one motion side by side and come to their levels together.

        None if any of the guards is another one.
        """
        guards, system = self.guards, self._nearby.system
        rows = guards.row[fired]
        is_held = ~(guards.is_velocity | guards.is_border | guards.is_normal)[fired] & system.is_friction[rows]
        if fired.size < 2 or not (is_held & (self._motion.equations.modes[rows] == 0)).all():
            return None
        lines = np.hstack([dense(system.G[rows]), system.D[rows]])
        factors = lines @ lines[0] / (lines[0] @ lines[0])
        apart = np.abs(lines - np.outer(factors, lines[0])).max()
        one_way = guards.direction[fired] * np.sign(factors)
        return np.abs(factors) if apart <= _PARALLEL * np.abs(lines).max() and np.ptp(one_way) == 0 else None

    def _comes_back(self, i: int, falls: float) -> bool:
        """Tell whether a guard that has left 0 falls about as fast as it left, as in each of many short flights."""
        guards = self.guards
        return bool(guards.order[i] == 1 and -falls > _ABOUT * guards.first[1, i])

    def _comes_down(self, i: int, size: Array, falls: float) -> bool:
        """Tell whether a guard falls at the end as it did on average since it was last clearly positive.

        A guard that grazes fell faster before. Where strong springs and dampers balance, a slope can be far below the
        terms that add up in it, and still be more than roundoff.
        """
        path = self._piece.kept_path
        back = path.taus[-1] - path.taus[0]
        before = path.taus[-1] - back * 0.5 ** np.arange(_HALVINGS)
        states = self._motion.exact(before, path.at(before).T)
        part = self.raw(self._motion, before, states)[i] / size[i]
        last = int(np.flatnonzero(part > _CLEARLY_POSITIVE)[-1:].max(initial=-1))
        if last < 0:
            return False
        mean = part[last] * size[i] / (path.taus[-1] - before[last])
        return bool(-falls > 0.5 * mean)

    def _with_stops(self, moved: Array, some: Indices, y: Array, S: Array, q: Array) -> Array:
        """Return the derivatives of some guards, those of stops without the roundoff of positions."""
        stops = [k for k, i in enumerate(some) if self.guards.is_border[i] and not self.is_continuous(i)]
        if stops:
            moved[stops] = self._nearby.border_slopes(y, q, S)[[self._border(some[k]) for k in stops]]
        return moved

    def _flies(self, i: int, tau: float, falls: float) -> float:
        """Return the speed at which a stop is left or reached again, as a part of the speeds of the whole motion.

        It is infinite for guards that watch no stop, and where the stop is reached more slowly than on average.
        """
        guards, system = self.guards, self._nearby.system
        if not guards.is_border[i] or self.is_continuous(i) or guards.order[i] > 1:
            return np.inf
        speed = abs(guards.first[1, i]) if guards.order[i] else falls
        if not guards.order[i] and falls * tau < guards.start[0, i]:
            return np.inf
        speeds = np.zeros(system.size)
        speeds[system.moved_state] = self._nearby.state_sizes[0]
        most = self._motion.equations.border_majorants(speeds, np.zeros(system.inputs))
        return float(speed / most[np.count_nonzero(guards.is_border[:i])])

    def falls(self, tau: float, y: Array) -> Array:
        """Return the slopes of all guards along the motion."""
        motion, guards = self._motion, self.guards
        if motion.is_linear:
            return np.asarray(guards.series(motion.expand(tau, y, 2))[1])
        own = guards.is_velocity
        found = self._nearby.falls(self.raw, motion, tau, y, self._is_linear & ~own)
        # those of velocities are accelerations: differences miss them where the friction curve is vertical at rest
        found[own] = guards.rows.sign[own] * motion.relative_accelerations(tau, y)[guards.row[own]]
        return found

    @property
    def _is_linear(self) -> Mask:
        """Which guards are linear in the state: velocities and distances, but no forces."""
        guards = self.guards
        return np.asarray((guards.is_velocity | guards.is_border) & (self._nearby.system.dependence is None))
