"""How a motion changes with small changes of its start and of its scene: first variations, exact through events.

While the modes hold, ``S = dy/dp`` at fixed time follows ``S' = f_y S + f_p``. An event at ``g(t, y, p) = 0`` moves by
``dt/dp = -(g_p + g_y S) / g'``, and S jumps there (saltation, Aizerman and Gantmakher 1958; Leine and Nijmeijer 2004):

    S+ = D[jump](S- + f- dt/dp) - f+ dt/dp

where D is the derivative of the jump of the state along all its arguments. Derivatives of the matrices of a scene with
respect to p are differences of fourth order between systems compiled near by; the flow, the events and the jumps
themselves are never differenced.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from stickslip.engines import METHODS
from stickslip.equations.loads.loads import Loads
from stickslip.equations.mode_equations import OPEN
from stickslip.equations.motion import Motion
from stickslip.equations.one_thread import one_thread
from stickslip.equations.system import System
from stickslip.events.endings import at_limit, at_stops, at_stops_at_start
from stickslip.model.arrays import Array, Indices, Mask
from stickslip.model.scene import Scene
from stickslip.results.pieces import Piece
from stickslip.results.trajectory import grouped
from stickslip.simulation import arguments
from stickslip.simulation.result import Result
from stickslip.simulation.simulate import compiled, simulate
from stickslip.studies.derivatives import kinks
from stickslip.studies.derivatives.directions import CENTRAL, PART, Direction
from stickslip.studies.derivatives.nearby import REST, Nearby, OfMotion, total
from stickslip.studies.derivatives.varied import VariedImpact, VariedPiece
from stickslip.studies.derivatives.varied_corners import corner_times
from stickslip.studies.derivatives.varied_flow import flow
from stickslip.studies.derivatives.varied_guards import TIE, VariedGuards

# Events nearer in time than this part of the time span count as one, if their derivatives differ.
_TOGETHER = 1e-10

_HIT_TOGETHER = "impacts fall together: the derivatives to the two sides differ"
_STEEP = "friction falls so steeply from rest (a Stribeck exponent below 1/2) that no derivative is known"

_SMALL = 1e-3  # a change of a parameter by this part of its size must leave two such events apart
_CONTINUOUS = 1e-12  # a load that changes at a break by no more than this part of itself does not jump
_BENT = 0.05  # velocities whose second difference exceeds this part of the first one are not linear there
_CANCELLED = 1e-9  # part of terms that cancel below which a derivative of a velocity is roundoff
_JUMP = 1e-7  # part of the speeds by which velocities after a jump may differ from those expected


def simulated(scene: Scene, t_span: arguments.Times, **options: Any) -> Result:
    """Return a simulated motion whose pieces are those of the whole scene, from event to event.

    With a longest step, however long, large scenes are not followed part by part. Methods of fixed steps are a
    ValueError: their motion has no derivatives.
    """
    span = arguments.span(t_span)
    method = options.get("method")
    if isinstance(method, str) and method in METHODS and METHODS[method].takes_steps:
        others = [
            name for name, known in METHODS.items() if not known.takes_steps and "contact-force" in known.formulations
        ]
        raise ValueError(
            f"method {method!r} changes modes at the ends of its steps, and its motion has no derivatives; "
            f"use 'auto' or {' or '.join(map(repr, others))}"
        )
    return simulate(_generic(scene), span, max_step=span[1] - span[0], **options)


def _generic(scene: Scene) -> Scene:
    """Return the scene with a `generic` system if its own one merges what is equal: near by it may not be equal."""
    if not isinstance(scene, Scene) or not compiled(scene).has_coincidences:
        return scene
    own = Scene(*scene.elements, motion=scene.motion)
    own.derived["system"] = System(own, generic=True)
    return own


class Variation(Nearby):
    """First variations of a simulated motion, computed when constructed: one of `pieces` per motion.

    `reasons` say where a derivative does not exist: time in s, number of the direction, why. From there on it is NaN.
    """

    def __init__(self, result: Result, directions: Sequence[Direction]) -> None:
        super().__init__(result, directions)
        self.reasons: list[tuple[float, int, str]] = []
        self.pieces: list[VariedPiece] = []
        self._relaxed = {(event.t, event.contact) for event in result.events if event.cause == "relaxation"}
        with one_thread(self.trajectory.system, always=True):
            self._follow()

    def _follow(self) -> None:
        """Follow the variations through all pieces and events."""
        trajectory = self.trajectory
        S, since = self._begin()
        begin = np.zeros(self.count)
        last = len(trajectory.pieces) - 1
        for number, piece in enumerate(trajectory.pieces):
            motion = self.motion_of(number)
            taus, coefficients, is_steep = flow(self, piece, motion, S, since, begin)
            until, end = np.full(self.count, np.inf), np.zeros(self.count)
            varied = VariedPiece(taus, coefficients, since, begin, end, until)
            self.pieces.append(varied)
            for k, why, tau in kinks.at_touches(self, number, motion, varied):
                self._refuse(piece.t + tau, [(k, why)])
                until[k] = min(until[k], tau)
            for kink in (
                *kinks.at_corners(self, number, motion, varied),
                *kinks.at_rise_from_nothing(self, number, motion),
                *kinks.at_loops(self, motion),
                *kinks.at_borders(self, number, motion, varied),
                *(enumerate([_STEEP] * self.count) if is_steep else ()),
            ):
                self._refuse(piece.t, [kink])
                until[kink[0]] = 0.0
            if number == last:
                break
            S = coefficients[-1].sum(axis=0) if coefficients.shape[0] else S
            S = np.where(until < np.inf, np.nan, S)
            end[:] = self._end(number, motion, S, since)
            length = piece.stop - piece.t
            if length <= _TOGETHER * (trajectory.span.stop - trajectory.span.start) and number:
                for k, direction in enumerate(self.directions):
                    change = abs(end[k] - begin[k])
                    # flights between rebounds that accumulate are short, but small changes do not make two rebounds one
                    stays = change * direction.size * _SMALL <= length
                    if not (stays or change <= TIE * (abs(begin[k]) + abs(end[k]))):
                        self._refuse(piece.stop, [(k, "two events fall together")], end)
            S, since = self._jump(number, motion, S, since, end)
            begin = end

    def _refuse(self, t: float, found: Iterable[tuple[int, str]], *derivatives: Array) -> None:
        """Note directions in which there is no derivative, and why, and make their derivatives NaN."""
        for k, why in found:
            if not any(one == k for _, one, _ in self.reasons):
                self.reasons.append((t, k, why))
            for one in derivatives:
                one[..., k] = np.nan

    def _refuse_all(self, t: float, why: str, derivatives: Array) -> None:
        """Note that there is no derivative in any direction, and why, and make all of them NaN."""
        self._refuse(t, [(k, why) for k in range(self.count)], derivatives)

    def give_up(self, k: int, why: str) -> None:
        """Let there be no derivative in a direction, and say why."""
        self.reasons[:] = [one for one in self.reasons if one[1] != k]
        self._refuse(self.trajectory.span.start, [(k, why)])
        for varied in self.pieces:
            varied.until[k] = 0.0
            varied.end_change[k] = np.nan

    def _begin(self) -> tuple[Array, Array]:
        """Return the variations at the start, held velocities made equal."""
        piece, system = self.trajectory.pieces[0], self.system
        n, t, y = system.n, piece.t, system.at_start()
        held = (piece.modes == 0) & system.hard
        S = np.array([one.y for one in self.directions]).T.reshape(system.size, self.count)
        S[self._unbent_bristles(piece)] = 0.0
        since = np.array([one.since for one in self.directions]).T.reshape(system.m, self.count)
        motion = self.motion_of(0)
        q = motion.segment.at(t)
        u = system.drive_velocities(q)
        none = np.zeros_like(u)
        sides = at_stops_at_start(system, y, q, t)
        hit = sides * system.relative_velocity(y, q) > 0
        nothing = np.zeros(system.m, dtype=bool)
        impact = VariedImpact(system, bool(hit.any()), y[:n], u, u, none, sides, hit, closed=nothing)
        for k, direction in enumerate(self.directions):
            if k in self.lost_breaks:
                why = (
                    "a break of a load comes to the start or the end, two of its points fall together, or it begins to "
                    "be cut off at 0"
                )
                self._refuse(t, [(k, why)], S)
                continue
            if direction.changes_to_one_side:
                self._refuse(t, [(k, "a contact carries no force, and near by it does, but to one side only")], S)
                continue
            slope, _ = impact.along(S[:n, k], 0.0)
            S[:n, k] = system.balance(held).project(slope, none) + self._of_scene(k, impact, held, t, t)
        self._refuse(t, kinks.at_start(self, piece, motion, S, since), S)
        self._refuse(t, kinks.at_stops(self, motion, S, sides), S)
        self._refuse(t, kinks.at_closed_stops(self, sides), S)
        return S, since

    def _unbent_bristles(self, piece: Piece) -> list[int]:
        """Return the states of bristles in open contacts, whose deflection stays 0."""
        return [state for j, state in self.system.bristle_state.items() if piece.modes[j] == OPEN]

    def _of_scene(self, k: int, impact: VariedImpact, held: Mask, before: float, t: float) -> Any:
        """Return the part of the derivative of the velocities after a jump at `t` that changes of the scene cause.

        It is the one in direction `k`. Drives jump there from the loads that hold after `before` to those after `t`.
        """

        def after(near: System, loads: Loads) -> Array:
            return near.balance(held).project(*self._near_jump(near, loads, impact, before, t))

        near_ones = self.near_ones[k]
        values = [after(near, loads) for _, near, loads in near_ones]
        parts = [weight * value for (weight, _, _), value in zip(near_ones, values, strict=True)]
        if np.count_nonzero(impact.hit) > 1 and len(values) == len(CENTRAL):
            (back, ahead), own = values[:2], after(self.system, self.trajectory.loads)
            bend, rough = np.abs(ahead + back - 2 * own).max(), _JUMP * PART * self.state_sizes[0]
            if bend > max(_BENT * np.abs(ahead - back).max(), rough):
                self._refuse(t, [(k, _HIT_TOGETHER)])
                return np.full(self.system.n, np.nan)
        return total(parts)

    def _relative_after(self, k: int, impact: VariedImpact, before: float, t: float) -> Any:
        """Return the part of the derivative of all relative velocities after an impact that changes of the scene cause.

        Held rows may move by them. The rest is as in `_of_scene`.
        """

        near_ones = self.near_ones[k]
        parts = [w * near.relative(*self._near_jump(near, loads, impact, before, t)) for w, near, loads in near_ones]
        return total(parts)

    def _near_jump(
        self, near: System, loads: Loads, impact: VariedImpact, before: float, t: float
    ) -> tuple[Array, Array]:
        """Return the velocities of bodies and drives after a jump in a scene near by, before rows hold again."""
        u, now = (near.drive_velocities(self.segment_after(start, loads).at(t)) for start in (before, t))
        return impact.near(near, u, now), now

    def _breaks_at(self, t: float) -> Array:
        """Return the changes of the times of all breaks of loads at time `t`, (breaks, directions)."""
        loads, near_by = self.trajectory.loads, _TOGETHER * (self.trajectory.span.stop - self.trajectory.span.start)
        here = []
        if any(abs(b - t) <= near_by for b in loads.breaks):
            places = ((i, j, b) for i, own in enumerate(loads.breaks_of) for j, b in enumerate(own))
            here = [(i, j) for i, j, b in places if abs(b - t) <= near_by]
        found = [[sum(w * one.breaks_of[i][j] for w, _, one in near) for near in self.near_ones] for i, j in here]
        times: Array = np.array(found, dtype=float).reshape(len(here), self.count)
        times[:, self.lost_breaks] = np.nan
        return times

    def _changes_at(self, number: int, motion: Motion) -> bool:
        """Tell whether modes change where a motion ends, or a load or the acceleration of a drive jumps."""
        piece, following = self.trajectory.pieces[number : number + 2]
        before, after = motion.loads(float(motion.horizon)), self.motion_of(number + 1).loads(0.0)
        jumps = np.abs(after - before) > _CONTINUOUS * np.maximum(np.abs(after), np.abs(before))
        return bool(jumps.any() or (following.modes != piece.modes).any())

    def _end(self, number: int, motion: Motion, S: Array, since: Array) -> Array:
        """Return how the time changes at which a motion ends."""
        piece, following = self.trajectory.pieces[number], self.trajectory.pieces[number + 1]
        path = piece.kept_path
        moved = self._breaks_at(piece.stop)
        if moved.size:
            times: Array = moved[0]
            apart = (np.abs(moved - times) > TIE * np.abs(moved).max(axis=0)).any(axis=0)
            if apart.any() and self._changes_at(number, motion):
                why = "loads break together, and near by one after the other, where one of them jumps or modes change"
                self._refuse(piece.stop, [(k, why) for k in apart.nonzero()[0].tolist()], times)
            self._refuse(piece.stop, kinks.at_break(self, piece, motion, S, since, times), times)
            self._refuse(piece.stop, kinks.beyond_break(self, number, motion, S, since, times), times)
            return times
        times = np.zeros(self.count)
        changes = following.modes != piece.modes
        closes = bool(changes.any() and (piece.modes[changes] == OPEN).all())
        if path.hit:
            guards = VariedGuards(self, piece, motion)
            times, reasons = guards.end(float(path.taus[-1]), S, since, self.pieces[number].begin_change)
            self._refuse(piece.stop, reasons.items())
        elif piece.end == 0 and (number or closes):
            # the motion has no length: the event before causes its end at once, as a gap that touches presses a contact
            times = self.pieces[number].begin_change.copy()
        elif closes and (found := corner_times(self, number, motion, S, since)) is not None:
            # a normal force that has been 0 rises from the corner of a table
            times, reasons = found
            self._refuse(piece.stop, reasons.items())
        elif changes.any() and all(t != piece.stop for t, _ in self._relaxed):
            # A relaxation is left out: it comes where a velocity falls below a margin, and its time counts as fixed.
            self._refuse_all(piece.stop, "the motion ends in a way that has no derivative here", times)
        return times

    def _jump(self, number: int, motion: Motion, S: Array, since: Array, times: Array) -> tuple[Array, Array]:
        """Return the variations after an event: saltation."""
        system, n = self.system, self.system.n
        piece, following = self.trajectory.pieces[number], self.trajectory.pieces[number + 1]
        path = piece.kept_path
        tau = float(path.taus[-1])
        after = self.motion_of(number + 1)
        by_time = np.outer(motion.rate(tau, path.last), times)
        moved = S + by_time
        # where both terms cancel, what is left is roundoff
        rough = _CANCELLED * (np.abs(S[:n]).max(axis=0) + np.abs(by_time[:n]).max(axis=0))
        # Karnopp's dead band sets the relative velocity to 0, even where the contact reverses at once
        turns = (system.laws.rests_below > 0) & (np.abs(piece.modes) == 1) & (following.modes == -piece.modes)
        held = ((following.modes == 0) & system.hard) | turns
        q = after.segment.at(following.t)
        u, rates = system.drive_velocities(q), system.drive_accelerations(q)
        balance = system.balance(held)
        impact = self._impact(number, motion)
        equal = balance.project(impact.after(), u)
        if np.abs(equal - following.y[:n]).max(initial=0.0) > _JUMP * self.state_sizes[0]:
            self._refuse_all(piece.stop, "velocities jump in a way that has no derivative here", moved)
            return moved, since
        relaxed = {name for t, name in self._relaxed if t == piece.stop}
        self._refuse(piece.stop, kinks.at_rest_together(self, number, motion, S, times, relaxed), times, moved)
        found = moved.copy()
        for k in range(self.count):
            slope, differs = impact.along(moved[:n, k], times[k])
            if differs > max(TIE * np.abs(slope).max(initial=0.0), rough[k]):
                self._refuse(piece.stop, [(k, _HIT_TOGETHER)], times)
                slope = np.full(n, np.nan)
            near = self._of_scene(k, impact, held, piece.t, following.t)
            if impact.jumps:
                free = system.relative(slope, rates * times[k]) + self._relative_after(k, impact, piece.t, following.t)
                if name := kinks.goes_on(after, free, max(TIE * np.abs(free).max(initial=0.0), rough[k])):
                    why = f"{name!r} has relative velocity 0 after an impact, and near by it slips on"
                    self._refuse(piece.stop, [(k, why)], times)
                    near = np.nan
            found[:n, k] = balance.project(slope, rates * times[k]) + near
        found -= np.outer(after.rate(0.0, following.y), times)
        found[self._unbent_bristles(following)] = 0.0
        if impact.jumps:
            self._refuse(piece.stop, kinks.after_impact(self, after, found, times), found)
        newly = following.since == following.t
        since = np.where(newly[:, None], times[None, :], since)
        self._refuse(piece.stop, kinks.beyond_event(self, following, after, found, since, times), found)
        return found, since

    def _impact(self, number: int, motion: Motion) -> VariedImpact:
        """Return how the velocities jump between a motion and the next one."""
        system, piece = self.system, self.trajectory.pieces[number]
        path, t = piece.kept_path, self.trajectory.pieces[number + 1].t
        segment = self.motion_of(number + 1).segment
        loads = [motion.segment.at(motion.t + float(path.taus[-1])), segment.at(t)]
        u, pace = [system.drive_velocities(q) for q in loads], system.drive_accelerations(loads[1])
        speed = np.abs(u[1]).max(initial=0.0) + self.state_sizes[0]
        crossed: Indices | tuple[()] = ()
        if system.has_stops and path.hit:
            crossed = at_limit(motion, VariedGuards(self, piece, motion).guards, path, []).crossed
        sides, new = at_stops(system, path.last, loads[1], piece.labels, path.largest, crossed, not path.is_chebyshev)
        hit = new & (sides * system.relative_velocity(path.last, loads[0]) > 0)
        is_soft = (system.is_friction | system.is_gap).all()
        is_pushed = not is_soft and np.abs(u[1] - u[0]).max(initial=0.0) > REST * speed
        jumps = bool(is_pushed or hit.any())
        closed = (piece.modes == 0) & ~(system.is_friction | system.is_gap | system.is_tie | hit)
        return VariedImpact(system, jumps, path.last[: system.n], u[0], u[1], pace, sides, hit, closed)

    # -- what is asked for -----------------------------------------------------------------------------------

    def states(self, times: Array) -> Array:
        """Return S at any times, (size, k, directions), right limits at events."""
        return self._read(times, lambda number, taus: self.pieces[number].at(taus))

    def quantity(self, quantity: OfMotion, times: Array) -> Array:
        """Return the derivatives of a quantity at any times, directions last."""
        return self._read(times, lambda number, taus: self.slopes_along(quantity, number, self.pieces[number], taus))

    def _read(self, times: Array, read: Callable[[int, Array], Array]) -> Array:
        """Return values at any times by reading each piece at local times; the last two axes are time and direction."""
        place = self.trajectory.places(times)
        taus = self.trajectory.local(place, times)
        parts = [(some, read(number, taus[some])) for number, some in grouped(place)]
        parts = parts or [(slice(None), read(0, times))]
        found = np.empty((*parts[0][1].shape[:-2], times.size, self.count))
        for some, part in parts:
            found[..., some, :] = part
        return found
