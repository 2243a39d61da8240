"""How a motion changes with small changes of its start and of its scene: first variations, exact through events.

While the modes hold, ``S = dy/dp`` at fixed time follows ``S' = f_y S + f_p``. An event at ``g(t, y, p) = 0`` moves by
``dt/dp = -(g_p + g_y S) / g'``, and S jumps there (saltation, Aizerman and Gantmakher 1958; Leine and Nijmeijer 2004):

    S+ = D[jump](S- + f- dt/dp) - f+ dt/dp

where D is the derivative of the jump of the state along all its arguments. Derivatives of the matrices of a scene with
respect to p are differences of fourth order between systems compiled near by; the flow, the events and the jumps
themselves are never differenced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.equations.guards import NEVER, Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, gauss_nodes
from stickslip.events.endings import at_limit, at_stops
from stickslip.model.scene import Scene
from stickslip.results.trajectory import Piece
from stickslip.simulation import arguments
from stickslip.simulation.result import Result
from stickslip.simulation.simulate import simulate
from stickslip.studies.directions import CENTRAL, MIRRORED, PART, Direction, start_of
from stickslip.studies.nearby import Nearby, Quantity
from stickslip.studies.varied import VariedImpact, VariedPiece
from stickslip.studies.varied_flow import flow

__all__ = ["Variation", "simulated"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_GRAZING = 1e-7
"""A guard that falls more slowly than this part of what adds up in its slope grazes."""

_TIE = 1e-6
_TIE_OF_ENGINES = 1e-13
"""Guards within this part of their scales come to 0 together for the engines."""

_TOGETHER = 1e-10
"""Events nearer in time than this part of the time span, but with different derivatives, count as one."""

_JUMP = 1e-7
_LOOKS, _NEAR, _TOUCH = 8, 1e-2, 1e-9
"""Looks at the guards in each step; part of its size below which a guard is followed to its minimum, and at which that
is a touch."""

_QUADRATURE, _ROUGH, _REFINED = 1e-10, 1e-12, 6
"""Part of an integral that a finer rule may change, and of what it is a derivative of; how often steps are halved."""

_REST = 1e-11
_TINY = np.finfo(float).tiny


def simulated(scene: Scene, t_span: arguments.Times, **options: Any) -> Result:
    """Return a simulated motion whose pieces are those of the whole scene, from event to event.

    A longest step, however long, keeps large scenes from being followed part by part.

    Raises
    ------
    ValueError, TypeError, SimulationError
        As `simulate` does.
    """
    span = arguments.span(t_span)
    return simulate(scene, span, max_step=span[1] - span[0], **options)


class Variation(Nearby):
    """First variations of a simulated motion, computed when constructed.

    Parameters
    ----------
    result : Result
        With its motion kept.
    directions : sequence of Direction

    Attributes
    ----------
    pieces : list of VariedPiece
        One per motion.
    reasons : list of (float, int, str)
        Where a derivative does not exist: time in s, number of the direction, why. From there on it is NaN.
    """

    def __init__(self, result: Result, directions: Sequence[Direction]) -> None:
        super().__init__(result, directions)
        self.reasons: list[tuple[float, int, str]] = []
        self.pieces: list[VariedPiece] = []
        self._relaxed = {(event.t, event.contact) for event in result.events if event.cause == "relaxation"}
        self._run()

    def _check_corners(self, number: int, motion: Motion) -> None:
        """Refuse directions that move tables off a corner at which they stay."""
        piece, dependence = self.trajectory.pieces[number], self.system.dependence
        if dependence is None or not dependence.tables or piece.end <= 0:
            return
        x = self.looked_up(number, np.linspace(0.1, 0.9, 5))
        for i, region in enumerate(motion.regions or ()):
            for corner in dependence.borders(i, region):
                if np.abs(x[i] - corner).max() > _TOUCH * (abs(corner) + np.abs(x[i]).max() or 1.0):
                    continue

                def looked_up(own: Motion, taus: Array, states: Array) -> Array:
                    q = own.inputs(taus, states)[: own.system.inputs]
                    assert own.system.dependence is not None
                    return np.asarray(own.system.dependence.looked_up(q, states) - corner)  # noqa: B023

                slopes = self.slope_of(looked_up, number, np.array([0.5 * piece.end]))[i, 0]
                for k in range(self.count):
                    if abs(slopes[k]) > _TIE * abs(corner or 1.0) / self.directions[k].size:
                        self._refuse(piece.t, k, f"a table stays at its corner {corner:g}")
                        self.pieces[number].until[k] = 0.0

    def slope_of(self, quantity: Quantity, number: int, taus: Array) -> Array:
        """Return the derivatives of a quantity at fixed local times of a piece, directions last."""
        piece = self.trajectory.pieces[number]
        varied = self.pieces[number]
        motion = self.motion_of(number)
        assert piece.path is not None
        y = motion.exact(taus, piece.path.at(taus).T)
        return self.slopes(quantity, piece, motion, varied.since, taus, y, varied.at(taus))

    # -- the run ---------------------------------------------------------------------------------------------

    def _run(self) -> None:
        trajectory = self.trajectory
        S, since = self._begin()
        begin = np.zeros(self.count)
        last = len(trajectory.pieces) - 1
        for number, piece in enumerate(trajectory.pieces):
            motion = self.motion_of(number)
            taus, coefficients = flow(self, piece, motion, S, since)
            self.pieces.append(
                VariedPiece(
                    taus, coefficients, since, begin, np.zeros(self.count), np.full(self.count, np.inf)
                )
            )
            self._check_touches(number, motion)
            self._check_corners(number, motion)
            until = self.pieces[-1].until
            at_end = coefficients[-1].sum(axis=0) if coefficients.shape[0] else S
            at_end = np.where(until < np.inf, np.nan, at_end)
            end = np.zeros(self.count)
            if number < last:
                end = self._end(number, motion, at_end, since)
                if piece.stop - piece.t <= _TOGETHER * (trajectory.span[1] - trajectory.span[0]) and number:
                    self._check_apart(piece, begin, end)
            self.pieces[-1] = VariedPiece(taus, coefficients, since, begin, end, until)
            if number < last:
                S, since = self._jump(number, motion, at_end, since, end)
                begin = end

    def _begin(self) -> tuple[Array, Array]:
        """Return the variations at the start, held velocities made equal."""
        piece, system = self.trajectory.pieces[0], self.system
        n, t = system.n, piece.t
        y, _ = start_of(system, t)
        if (bristles := system.size - system.first_bristle) > 0:
            y[-bristles:] = piece.y[-bristles:]
        held = ((piece.modes == 0) & system.hard).tobytes()
        S = np.array([one.y for one in self.directions]).T.reshape(system.size, self.count)
        since = np.array([one.since for one in self.directions]).T.reshape(system.m, self.count)
        motion = self.motion_of(0)
        u = system.drive_velocities(motion.stretch.at(t))
        none = np.zeros_like(u)
        sides, _ = at_stops(system, y, motion.stretch.at(t))
        hit = sides * system.relative_velocity(y, motion.stretch.at(t)) > 0
        impact = VariedImpact(system if hit.any() else None, u, u, none, sides, hit)
        for k, direction in enumerate(self.directions):
            if len(direction.near) != len(self.near_ones[k]):
                self._refuse(
                    t, k, "the breaks of the loads fall together or a load begins to be cut off at 0"
                )
                S[:, k] = np.nan
                continue
            slope, _ = impact.along(y[:n], S[:n, k], 0.0)
            v = system.balance(held).project(slope, none)
            for weight, near, loads in direction.near:
                own = near.drive_velocities(self.stretch_after(t, loads).at(t))
                v = v + weight * near.balance(held).project(impact.after(y[:n], near, own, own), own)
            S[:n, k] = v
        self._check_start(piece, motion, S)
        self._check_start_at_stops(piece, motion, S, sides)
        return S, since

    def _check_start_at_stops(self, piece: Piece, motion: Motion, S: Array, sides: NDArray[np.int8]) -> None:
        """Refuse directions that move stops off a limit at which they start, or beyond it."""
        system = self.system
        if not sides.any():
            return
        functions, none = system.piecewise, np.zeros((system.m, self.count))

        def border(own: Motion, taus: Array, states: Array) -> Array:
            q, matrices = own.loads(taus), own.system.piecewise
            return np.asarray(matrices.border_y @ states + matrices.border_q @ q[: system.inputs])

        slopes = self.slopes(border, piece, motion, none, np.zeros(1), piece.y[:, None], S[:, None, :])[:, 0]
        on_side = sides[functions.row[functions.owner]]
        at = functions.is_stop[functions.owner] & (np.where(functions.beyond == 1, 1, -1) == on_side)
        for k in range(self.count):
            off = (at & (np.abs(slopes[:, k]) > _TIE / self.directions[k].size)).nonzero()[0]
            if off.size:
                label = functions.labels[functions.owner[off[0]]]
                self._refuse(
                    piece.t, k, f"{label} starts at its limit: the derivatives to the two sides differ"
                )
                S[:, k] = np.nan

    def _check_start(self, piece: Piece, motion: Motion, S: Array) -> None:
        """Refuse directions that move rows off rest at the start in which rows have just begun to slip."""
        at = np.zeros(1)
        rows = self._starting(piece, motion)
        if not rows.size:
            return
        w = self.slopes(
            _relative,
            piece,
            motion,
            np.zeros((self.system.m, self.count)),
            at,
            piece.y[:, None],
            S[:, None, :],
        )
        scale = self._speed_slopes(S, np.zeros(self.system.n), np.zeros(self.count))
        for k in range(self.count):
            off = rows[np.abs(w[rows, 0, k]) > _TIE * scale[k]]
            if off.size:
                self._refuse(
                    piece.t,
                    k,
                    f"{self._row(off[0])} starts at relative velocity 0 and begins to slip: "
                    "the derivatives to the two sides differ",
                )
                S[:, k] = np.nan

    def _starting(self, piece: Piece, motion: Motion) -> Indices:
        """Return the rows that begin to slip from relative velocity 0."""
        equations = motion.equations
        return np.asarray(equations.slip[self._at_rest(piece, motion)[equations.slip]])

    def _at_rest(self, piece: Piece, motion: Motion) -> NDArray[np.bool_]:
        system = self.system
        w = system.relative_velocity(piece.y, motion.loads(0.0))
        return np.asarray(np.abs(w) <= np.maximum(_REST * self.state_sizes[0], system.laws.rests_below))

    def _speed_slopes(self, S: Array, rate: Array, times: Array) -> Array:
        """Return for each direction the size of what adds up in derivatives of velocities."""
        n = self.system.n
        sizes = np.array([one.size for one in self.directions])
        found = np.abs(S[:n]).max(axis=0, initial=0.0) + np.abs(rate[:n]).max(initial=0.0) * np.abs(times)
        return np.asarray(found + 1e-4 * self.state_sizes[0] / sizes)

    def _refuse(self, t: float, k: int, why: str) -> None:
        if not any(one == k for _, one, _ in self.reasons):
            self.reasons.append((t, k, why))

    def _row(self, j: int) -> str:
        return repr(self.system.rows[int(j)].name)

    def _guarded(self, guards: Guards, i: int) -> str:
        """Return what a guard belongs to: a row, or a piecewise-linear function."""
        if not guards.is_border[i]:
            return self._row(guards.row[i])
        functions = self.system.piecewise
        return str(functions.labels[functions.owner[self._border(guards, i)]])

    @staticmethod
    def _border(guards: Guards, i: int) -> int:
        """Return the border that a guard watches, among those of all functions."""
        return int(guards.motion.equations.borders[np.count_nonzero(guards.is_border[:i])])

    # -- events ----------------------------------------------------------------------------------------------

    def _end(self, number: int, motion: Motion, S: Array, since: Array) -> Array:
        """Return how the time changes at which a motion ends."""
        piece, following = self.trajectory.pieces[number], self.trajectory.pieces[number + 1]
        path = piece.path
        assert path is not None
        tau = float(path.taus[-1])
        breaks = self.trajectory.loads.breaks
        span = self.trajectory.span[1] - self.trajectory.span[0]
        near_break = [i for i, b in enumerate(breaks) if abs(b - piece.stop) <= _TOGETHER * span]
        if near_break:
            times = np.array([self._of_break(near_break[0], k) for k in range(self.count)])
            self._check_guards_at_break(piece, motion, tau, S, since, times)
            self._check_level_after_break(number, motion, S, since, times)
            return times
        if path.hit:
            return self._of_guards(piece, motion, tau, S, since)
        if any(t == piece.stop for t, _ in self._relaxed):
            # the time is that at which the velocity falls below a margin: it says nothing about the scene
            return np.zeros(self.count)
        if np.any(following.modes != piece.modes):
            for k in range(self.count):
                self._refuse(piece.stop, k, "the motion ends in a way that has no derivative here")
            return np.full(self.count, np.nan)
        return np.zeros(self.count)

    def _of_break(self, i: int, k: int) -> float:
        return float(sum(weight * loads.breaks[i] for weight, _, loads in self.near_ones[k]))

    def _guards(self, piece: Piece, motion: Motion) -> Guards:
        rest = self._at_rest(piece, motion) & ~motion.equations.is_held
        return Guards(motion, piece.labels, rest, np.zeros(self.system.m, dtype=bool))

    def _sizes(self, guards: Guards, path: Path) -> tuple[Array, Array]:
        """Return what adds up in the guards and in their slopes: in borders what does along the whole path."""
        _, size = guards.at_end(path)
        slopes = guards.majorant[1]
        if guards.is_border.any():
            system, equations = self.system, guards.motion.equations
            largest, q = np.abs(path.largest), np.abs(guards.motion.start_inputs)
            pace = np.abs(guards.motion.rate(float(path.taus[-1]), path.last))
            pace[system.moved_state] = largest[system.moved]
            size, slopes = size.copy(), slopes.copy()
            size[guards.is_border] = equations.border_magnitudes(largest, q)
            slopes[guards.is_border] = equations.border_magnitudes(pace, np.zeros_like(q))
        return size, slopes

    def _of_guards(self, piece: Piece, motion: Motion, tau: float, S: Array, since: Array) -> Array:
        """Return how the time changes at which guards come to 0."""
        guards = self._guards(piece, motion)
        path = piece.path
        assert path is not None
        y = path.last
        values = guards.values(tau, y)
        size, slopes = self._sizes(guards, path)
        part = values / np.where(size > 0, size, 1.0)
        fired = (part <= max(0.0, float(part.min(initial=np.inf))) + _TIE_OF_ENGINES).nonzero()[0]
        if not fired.size:
            for k in range(self.count):
                self._refuse(piece.stop, k, "the motion ends in a way that has no derivative here")
            return np.full(self.count, np.nan)
        raw = self._raw(piece, guards, motion)
        is_straight, at = bool(self._straight(guards)[fired].all()), np.array([tau])
        moved = self.slopes(raw, piece, motion, since, at, y[:, None], S[:, None, :], is_straight)[fired, 0]
        falls = self._fall(motion, guards, tau, y)[fired]
        steep = np.divide(np.abs(falls), slopes[fired], out=np.zeros(falls.size), where=slopes[fired] > 0)
        # of guards that fall together, the one that grazes least tells the time
        first = int(np.argmax(steep))
        names = sorted({self._guarded(guards, int(i)) for i in fired})
        if steep[first] <= _GRAZING:
            for k in range(self.count):
                self._refuse(piece.stop, k, f"{names[0]} grazes: its guard comes to 0 with slope 0")
            return np.full(self.count, np.nan)
        times = -moved[first] / falls[first]
        off = moved + falls[:, None] * times
        limit = _TIE * (np.abs(moved) + np.abs(falls[:, None] * times)) + 1e-9 * size[fired][:, None]
        for k in range(self.count):
            if np.any(np.abs(off[:, k]) > limit[:, k]):
                self._refuse(piece.stop, k, f"events of {' and '.join(names)} fall together")
                times[k] = np.nan
        return np.asarray(times)

    def _fall(self, motion: Motion, guards: Guards, tau: float, y: Array) -> Array:
        """Return the slopes of all guards along the motion."""
        if motion.is_linear:
            return np.asarray(guards.series(motion.expand(tau, y, 2))[1])
        rate = motion.rate(tau, y)
        pace = float((np.abs(rate) / self.state_sizes).max(initial=0.0))
        h = 0.1 * PART * min(1.0 / pace if pace > 0 else np.inf, max(motion.horizon, _TINY))
        stencil = CENTRAL if tau + 2 * h <= motion.horizon else MIRRORED
        offsets = np.array([offset for offset, _ in stencil]) * h
        weights = np.array([weight for _, weight in stencil]) / h

        def slope(taus: Array, states: Array, weights: Array) -> Array:
            values = guards.raw(motion.watched(taus, states), motion.inputs(taus, states))
            return np.asarray(values @ weights)

        # along the tangent and its change: the parabola of the motion
        ahead = motion.rate(tau + offsets, y[:, None] + offsets * rate[:, None])
        found = slope(tau + offsets, y[:, None] + 0.5 * offsets * (rate[:, None] + ahead), weights)
        straight = self._straight(guards)
        if pace > 0 and straight.any():
            by_time = slope(tau + offsets, np.repeat(y[:, None], offsets.size, axis=1), weights)
            far = y[:, None] + np.outer(rate, [1.0 / pace, -1.0 / pace])
            by_state = slope(np.array([tau, tau]), far, np.array([0.5 * pace, -0.5 * pace]))
            found[straight] = (by_time + by_state)[straight]
        return found

    def _straight(self, guards: Guards) -> NDArray[np.bool_]:
        """Tell which guards are linear in the state: velocities and distances, but no forces."""
        return np.asarray((guards.is_velocity | guards.is_border) & (self.system.dependence is None))

    def _check_guards_at_break(
        self, piece: Piece, motion: Motion, tau: float, S: Array, since: Array, times: Array
    ) -> None:
        """Refuse directions in which an event that falls on a break of a load would come before or after it."""
        guards = self._guards(piece, motion)
        if not guards.size:
            return
        path = piece.path
        assert path is not None
        y = path.last
        values = guards.values(tau, y)
        size, _ = self._sizes(guards, path)
        at = ((values <= _TOUCH * size) & (guards.order != NEVER)).nonzero()[0]
        if not at.size:
            return
        raw = self._raw(piece, guards, motion)
        moved = self.slopes(raw, piece, motion, since, np.array([tau]), y[:, None], S[:, None, :])[:, 0]
        moved = moved + np.outer(self._fall(motion, guards, tau, y), times)
        for i, k in self._moving(guards, at, moved):
            self._refuse(piece.stop, k, f"an event of {self._guarded(guards, i)} falls on a break of a load")
            times[k] = np.nan

    def _check_level_after_break(
        self, number: int, motion: Motion, S: Array, since: Array, times: Array
    ) -> None:
        """Refuse directions in which a load that jumps exactly to a level would jump beyond it or stay below."""
        piece, following = self.trajectory.pieces[number], self.trajectory.pieces[number + 1]
        assert piece.path is not None
        if not np.any((following.modes != piece.modes) & (piece.modes == 0) & self.system.is_friction):
            return
        stayed = replace(piece, t=following.t, y=piece.path.last)
        stretch = self.motion_of(number + 1).stretch
        held = Motion(motion.equations, stretch, following.t, stayed.y, piece.since)
        guards = self._guards(stayed, held)
        at = ((np.abs(guards.start[0]) <= _TOUCH * guards.scale) & ~guards.is_velocity).nonzero()[0]
        if not at.size:
            return
        y = held.exact(0.0, stayed.y)
        rate = motion.rate(float(piece.path.taus[-1]), piece.path.last) - held.rate(0.0, y)
        raw, moved = self._raw(stayed, guards, held), S + np.outer(rate, times)
        slopes = self.slopes(raw, stayed, held, since, np.zeros(1), y[:, None], moved[:, None, :])[:, 0]
        slopes = slopes + np.outer(self._fall(held, guards, 0.0, y), times)
        for i, k in self._moving(guards, at, slopes):
            self._refuse(piece.stop, k, f"{self._guarded(guards, i)} comes to its level on a break of a load")
            times[k] = np.nan

    def _moving(self, guards: Guards, some: NDArray[np.intp], slopes: Array) -> list[tuple[int, int]]:
        """Return guards among some, and directions that move them by more than roundoff."""
        found = np.argwhere(np.abs(slopes[some]) > self._noise(guards)[some])
        return [(int(some[i]), int(k)) for i, k in found]

    def _check_touches(self, number: int, motion: Motion) -> None:
        """Refuse what follows where a guard touches 0 without crossing it: an event begins or vanishes there."""
        piece = self.trajectory.pieces[number]
        path = piece.path
        assert path is not None
        if piece.end <= 0 or not motion.equations.guards.size:
            return
        guards = self._guards(piece, motion)
        parts = np.linspace(0.0, 1.0, _LOOKS + 1)[:-1]
        taus = np.append((path.taus[:-1, None] + np.diff(path.taus)[:, None] * parts).ravel(), piece.end)
        g = guards.values(taus, motion.exact(taus, path.at(taus).T))
        size = self._sizes(guards, path)[0][:, None]
        inner = g[:, 1:-1]
        low = (inner <= g[:, :-2]) & (inner < g[:, 2:]) & (inner < _NEAR * size)
        for i, at in zip(*low.nonzero(), strict=True):
            if guards.order[i] == NEVER or self._is_continuous(guards, int(i)):
                continue

            def value(tau: float, i: int = int(i)) -> float:
                y = motion.exact(tau, path.at(np.array([tau]))[0])
                return float(guards.values(tau, y)[i])

            bounds = (taus[at], taus[at + 2])
            found = scipy.optimize.minimize_scalar(
                value, bounds=bounds, method="bounded", options={"xatol": 1e-12}
            )
            if found.fun <= _TOUCH * size[i, 0]:
                self._touched(number, motion, guards, int(i), float(found.x))

    def _is_continuous(self, guards: Guards, i: int) -> bool:
        """Tell whether a guard is a border at which the force only has a corner: to touch it changes nothing."""
        functions = self.system.piecewise
        return bool(guards.is_border[i]) and not functions.is_stop[functions.owner[self._border(guards, i)]]

    def _touched(self, number: int, motion: Motion, guards: Guards, i: int, tau: float) -> None:
        """Refuse the directions that lift a guard off 0 where it touches it, or lower it."""
        piece, varied = self.trajectory.pieces[number], self.pieces[number]
        slopes = self.slope_of(self._raw(piece, guards, motion), number, np.array([tau]))[i, 0]
        limit = self._noise(guards)[i]
        for k in range(self.count):
            if abs(slopes[k]) > limit[k]:
                why = f"{self._guarded(guards, i)} grazes: its guard touches 0 without crossing it"
                self._refuse(piece.t + tau, k, why)
                varied.until[k] = min(varied.until[k], tau)

    def _noise(self, guards: Guards) -> Array:
        """Return below what a derivative of a guard in each direction counts as 0, (guards, directions)."""
        sizes = np.array([one.size for one in self.directions])
        return np.asarray(_TIE * np.maximum(guards.scale, guards.majorant[0])[:, None] / sizes)

    def _raw(self, piece: Piece, guards: Guards, motion: Motion) -> Quantity:
        """Return the guards of a motion, and of others near by, as a quantity."""

        def raw(own: Motion, taus: Array, states: Array) -> Array:
            near = guards
            if own is not motion:
                near = Guards(own, piece.labels, guards.at_rest, np.zeros(self.system.m, dtype=bool))
            return near.raw(own.watched(taus, states), own.inputs(taus, states))

        return raw

    def _check_apart(self, piece: Piece, begin: Array, end: Array) -> None:
        for k in range(self.count):
            if not abs(begin[k] - end[k]) <= _TIE * (abs(begin[k]) + abs(end[k])):
                self._refuse(piece.stop, k, "two events fall together")
                end[k] = np.nan

    def _jump(self, number: int, motion: Motion, S: Array, since: Array, times: Array) -> tuple[Array, Array]:
        """Return the variations after an event: saltation."""
        system, n = self.system, self.system.n
        piece, following = self.trajectory.pieces[number], self.trajectory.pieces[number + 1]
        path = piece.path
        assert path is not None
        tau = float(path.taus[-1])
        after = self.motion_of(number + 1)
        moved = S + np.outer(motion.rate(tau, path.last), times)
        held = ((following.modes == 0) & system.hard).tobytes()
        q = after.stretch.at(following.t)
        u, rates = system.drive_velocities(q), system.drive_accelerations(q)
        balance = system.balance(held)
        impact = self._impact(number, motion)
        equal = balance.project(impact.after(path.last[:n]), u)
        if np.abs(equal - following.y[:n]).max(initial=0.0) > _JUMP * self.state_sizes[0]:
            for k in range(self.count):
                self._refuse(piece.stop, k, "velocities jump in a way that has no derivative here")
            return np.full_like(S, np.nan), since
        self._check_rest(piece, following, motion, S, moved, times)
        found = moved.copy()
        for k, near_ones in enumerate(self.near_ones):
            slope, differs = impact.along(path.last[:n], moved[:n, k], times[k])
            if differs > _TIE * np.abs(slope).max(initial=0.0):
                self._refuse(piece.stop, k, "impacts fall together: the derivatives to the two sides differ")
                times[k], slope = np.nan, np.full(n, np.nan)
            v = balance.project(slope, rates * times[k])
            for weight, near, loads in near_ones:
                own = near.drive_velocities(self.stretch_after(following.t, loads).at(following.t))
                before = near.drive_velocities(self.stretch_after(piece.t, loads).at(following.t))
                v = v + weight * near.balance(held).project(
                    impact.after(path.last[:n], near, before, own), own
                )
            found[:n, k] = v
        found -= np.outer(after.rate(0.0, following.y), times)
        newly = following.since == following.t
        since = np.where(newly[:, None], times[None, :], since)
        return found, since

    def _impact(self, number: int, motion: Motion) -> VariedImpact:
        """Return how the velocities jump between a motion and the next one."""
        system, piece = self.system, self.trajectory.pieces[number]
        path, t = piece.path, self.trajectory.pieces[number + 1].t
        assert path is not None
        stretch = self.motion_of(number + 1).stretch
        loads = [motion.stretch.at(motion.t + float(path.taus[-1])), stretch.at(t)]
        u, pace = [system.drive_velocities(q) for q in loads], system.drive_accelerations(loads[1])
        jumps = np.abs(u[1] - u[0]).max(initial=0.0) > _REST * (
            np.abs(u[1]).max(initial=0.0) + self.state_sizes[0]
        )
        crossed: Indices = np.empty(0, dtype=np.intp)
        if system.has_stops and path.hit:
            crossed = at_limit(motion, self._guards(piece, motion), path, []).crossed
        sides, new = at_stops(system, path.last, loads[1], piece.labels, path.largest, crossed)
        w = system.relative_velocity(path.last, loads[0])
        hit = new & (sides * w > 0)
        if not hit.any() and (not jumps or (system.is_friction | system.is_gap).all()):
            return VariedImpact(None, u[0], u[1], pace, sides, hit)
        return VariedImpact(system, u[0], u[1], pace, sides, hit)

    def _check_rest(
        self, piece: Piece, following: Piece, motion: Motion, S: Array, moved: Array, times: Array
    ) -> None:
        """Refuse directions in which rows that come to rest together would do so one after the other."""
        system = self.system
        path = piece.path
        assert path is not None
        tau = float(path.taus[-1])
        before = (np.abs(piece.modes) == 1) & system.hard
        w = system.relative_velocity(path.last, motion.loads(tau))
        rests = (following.modes == 0) | (following.modes == -piece.modes)
        rows = (before & rests & (np.abs(w) <= 1e-9 * self.state_sizes[0])).nonzero()[0]
        rows = rows[system.laws.rests_below[rows] == 0]
        if not rows.size:
            return
        still = np.zeros((system.m, self.count))
        slopes = self.slopes(
            _relative, piece, motion, still, np.array([tau]), path.last[:, None], S[:, None, :]
        )[:, 0]
        rate = motion.rate(tau, path.last)
        pace = system.G @ rate[: system.n]
        if system.drives:
            pace = pace + system.D @ system.drive_accelerations(motion.loads(tau))
        slopes = slopes + np.outer(pace, times)
        scale = self._speed_slopes(S, rate, times)
        relaxed = {name for t, name in self._relaxed if t == piece.stop}
        for k in range(self.count):
            off = [
                j
                for j in rows
                if not abs(slopes[j, k]) <= _TIE * scale[k] and system.rows[j].name not in relaxed
            ]
            if off and np.isfinite(times[k]):
                self._refuse(piece.stop, k, f"events fall together: {self._row(off[0])} comes to rest, too")
                times[k] = np.nan
                moved[:, k] = np.nan

    # -- what is asked for -----------------------------------------------------------------------------------

    def changes(self) -> list[tuple[float, Array]]:
        """Return the time of the end of each motion but the last in s, and how it changes."""
        pieces = self.trajectory.pieces[:-1]
        return [(piece.stop, varied.end) for piece, varied in zip(pieces, self.pieces, strict=False)]

    def states(self, times: Array) -> Array:
        """Return S at any times, (size, k, directions), right limits at events."""
        found = np.empty((self.system.size, times.size, self.count))
        place = self.trajectory.places(times)
        taus = self.trajectory.local(place, times)
        for number in np.unique(place).tolist():
            chosen = place == number
            found[:, chosen] = self.pieces[number].at(taus[chosen])
        return found

    def quantity(self, quantity: Quantity, times: Array) -> Array:
        """Return the derivatives of a quantity at any times, directions last."""
        place = self.trajectory.places(times)
        taus = self.trajectory.local(place, times)
        parts = [
            self.slope_of(quantity, number, taus[place == number]) for number in np.unique(place).tolist()
        ]
        joined = np.concatenate(parts, axis=-2)
        order = np.concatenate([(place == number).nonzero()[0] for number in np.unique(place).tolist()])
        found = np.empty_like(joined)
        found[..., order, :] = joined
        return found

    def _sums(self, quantity: Quantity, number: int, edges: Array) -> Array:
        """Return the integrals of the derivatives of a quantity from the start of a piece to some local times."""
        piece, varied = self.trajectory.pieces[number], self.pieces[number]
        nodes, weights = gauss_nodes(varied.coefficients.shape[1])
        half = 0.5 * np.diff(edges)
        taus = (0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * nodes).ravel()
        if not half.size:
            motion = self.motion_of(number)
            lines = quantity(motion, np.zeros(1), piece.y[:, None]).shape[0]
            return np.zeros((lines, edges.size, self.count))
        slopes = self.slope_of(quantity, number, taus).reshape(-1, half.size, nodes.size, self.count)
        sums = np.zeros((slopes.shape[0], edges.size, self.count))
        sums[:, 1:] = np.cumsum(np.einsum("lijk,j,i->lik", slopes, weights, half), axis=1)
        return sums

    def integral(self, quantity: Quantity, times: Array) -> Array:
        """Return the derivatives of time integrals from the start to times in order, (lines, k, directions).

        ``d/dp int f dt = int df/dp dt + sum (f- - f+) dt_event/dp``; the quantity has a line for each integral.
        """
        place = self.trajectory.places(times)
        local = self.trajectory.local(place, times)
        sizes = np.array([one.size for one in self.directions])
        parts: list[Array] = []
        total: Array | float = 0.0
        for number in range(int(place.max(initial=-1)) + 1):
            piece, varied = self.trajectory.pieces[number], self.pieces[number]
            motion = self.motion_of(number)
            path = piece.path
            assert path is not None
            wanted = local[place == number]
            edges = np.unique(np.concatenate([varied.taus, path.taus, wanted]))
            ends = np.array([0.0, piece.end])
            limits = quantity(motion, ends, motion.exact(ends, path.at(ends).T))[:, :, None]
            sums = self._sums(quantity, number, edges)
            rough = _ROUGH * np.abs(limits).max(initial=0.0) * piece.end / sizes
            for _ in range(_REFINED):
                if edges.size < 2:
                    break
                middles = 0.5 * (edges[1:] + edges[:-1])
                edges = np.insert(edges, np.arange(1, edges.size), middles)
                finer = self._sums(quantity, number, edges)
                off, size = np.abs(finer[:, ::2] - sums), np.abs(finer).max(axis=(0, 1))
                sums = finer
                # a line that hardly changes is roundoff of those that do, and of the quantity itself
                if not np.any(off > _QUADRATURE * size + rough):
                    break
            sums += total - limits[:, :1] * varied.begin
            parts.append(sums[:, np.searchsorted(edges, wanted)])
            total = sums[:, -1:] + limits[:, 1:] * varied.end
        return np.concatenate(parts, axis=1)


def _relative(motion: Motion, taus: Array, y: Array) -> Array:
    return motion.system.relative_velocity(y, motion.loads(taus))
