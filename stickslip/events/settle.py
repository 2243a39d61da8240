"""Which modes are consistent now: all rows at rest are settled together (MODEL rules 3, 4 and 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip.equations.algebra.matrices import row_maxima
from stickslip.equations.guards.at_start import ROUNDOFF
from stickslip.equations.guards.guards import Guards
from stickslip.equations.guards.values import AT_BAND
from stickslip.equations.loads.dependence import Friction
from stickslip.equations.loads.loads import Loads, Segment, TableRegions
from stickslip.equations.mode_equations import APART, FREE, OPEN, equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.events.collapse import pressed_together
from stickslip.events.impact import Jammed, Struck
from stickslip.events.labels import label
from stickslip.events.search import Search, moving_at_level
from stickslip.events.situation import Inconsistent, Situation, Uncertainty
from stickslip.model.arrays import Array, Indices, Mask, Modes

_OF_PHASE = 1e-3  # a sine that is 0 has the roundoff of its phase: that of this part of its amplitude


@dataclass(frozen=True)
class Settled:
    """Consistent modes and the motion that starts with them."""

    labels: Modes  # (m,): the mode that each row shows: -1, 0 or +1; OPEN where a gap or stop is
    motion: Motion
    guards: Guards
    impact: Struck | None = None  # the impact with which the motion began; None for none


def modes_after_break(last: Settled, segment: Segment, t: float, y: Array, largest: Array) -> Modes | None:
    """Return the modes after a break of loads where no row at rest has to be settled; None where more may change.

    Velocities do not jump, and rows that slip or are open move: a contact that is pressed from now on slips, and one
    that is no longer pressed goes on without friction. Held rows stay held.

    `last` is the motion up to `t`, `segment` the loads from there on; `largest` bounds the sizes of the states on the
    way.
    """
    motion, system = last.motion, last.motion.system
    if t < motion.segment.stop or system.has_stops or system.sampled or system.dependence is not None:
        return None
    if system.drives and motion.equations.at_level.size:
        # drives may tear away the rows that hold in place of those at their level
        return None
    q = segment.at(t)
    if system.drives and (system.drive_velocities(q) != system.drive_velocities(motion.segment.at(t))).any():
        return None
    modes = motion.equations.modes
    changes = open_or_close(modes, system, segment, t, q)
    if comes_to_rest(last, t, y, largest, q, changes):
        return None
    if not np.count_nonzero(changes):
        return modes
    if np.count_nonzero(changes & ~system.hard):
        return None
    return np.where(changes, np.where(modes == OPEN, last.labels, OPEN), modes).astype(np.int8)


def open_or_close(modes: Modes, system: System, segment: Segment, t: float, q: Array) -> Mask:
    """Tell which rows can carry a force from a break of the loads on and could not before, or the other way round.

    `q` are the inputs from there on.
    """
    return np.asarray((modes == OPEN) == _closed(system, segment, t, q))


def comes_to_rest(last: Settled, t: float, y: Array, largest: Array, q: Array, changes: Mask | bool = False) -> bool:
    """Tell whether a row that moves, or one of the `changes`, is at rest at the end of a motion, but for roundoff.

    `q` are the inputs from there on.
    """
    motion = last.motion
    modes = motion.equations.modes
    is_open = modes == OPEN
    if (is_open & (last.labels == 0)).any():
        # an open row that shows STUCK is at rest: its velocity is roundoff of its forces, however fast others are
        return True
    moves = (np.abs(modes) == 1) | is_open | changes
    w, rough = _relative(motion.system, motion.segment, y, largest, t, q)
    if last.guards.velocity_uncertainty is not None:
        rough = np.maximum(rough, last.guards.velocity_uncertainty)
    return bool(np.count_nonzero(moves & (np.abs(w) <= rough)))


def all_pressed(system: System, segment: Segment, t: float) -> bool:
    """Tell whether loads still press all rows: with fixed steps one may have opened unseen within a step."""
    return not segment.is_stepped or bool((_closed(system, segment, t, segment.at(t)) | system.pressed).all())


def carried_on(last: Settled, segment: Segment, t: float, y: Array, modes: Modes) -> Settled | None:
    """Return the motion after a sample or a break in some modes, None where these may not hold.

    Rows show the same modes as before.
    """
    motion = last.motion
    equations = equations_in(modes, motion.system, motion.equations.regions)
    following = Motion(equations, segment, t, motion.exact(t - motion.t, y), motion.since)
    if following.equations.balance.parting is not None or moving_at_level(following).size:
        # drives tear rows from here on, or move what others held at rest
        return None
    none = np.zeros(last.labels.size, dtype=bool)
    guards = Guards(following, last.labels, none, none, last.guards.velocity_uncertainty)
    if guards.violated.any() or guards.misjudged.size or not guards.is_plain:
        return None
    return Settled(last.labels, following, guards)


def with_one(
    last: Settled,
    t: float,
    y: Array,
    since: Array,
    row: int,
    direction: int,
    velocity_uncertainty: Array | None,
) -> Settled | None:
    """Return the motion to come where one row alone has come to its limit, None where more may change with it.

    A row that moved sticks; if it cannot be held, it moves on in the direction in which it is pushed. A held row lets
    go in its `direction`, which is 0 for a row that moved. All others keep their modes. `since` is when each row last
    became held.
    """
    motion, system = last.motion, last.motion.system
    equations = motion.equations
    if (
        not system.all_hard
        or system.has_dead_bands
        or system.has_stops
        or equations.at_level.size
        # an open row whose velocity is not watched may begin to move
        or last.guards.rows.loose < equations.open.size
    ):
        return None
    held = equations.is_held.copy()
    held[row] = True
    balance = system.balance(held)
    may_be_spared = balance.has_loops
    if (direction and may_be_spared) or balance.parting is not None:
        # others may hold in place of the row, or drives may tear rows
        return None
    if direction:
        y = motion.exact(t - motion.t, y)
    else:
        u = system.drive_velocities(motion.segment.at(t)) if system.drives else y[:0]
        y = system.with_held(y, u, held)
    modes, labels, at_level = equations.modes.copy(), last.labels.copy(), np.zeros(system.m, dtype=bool)
    at_level[row] = direction != 0
    while True:
        modes[row] = labels[row] = direction
        following = Motion(equations_in(modes, system, equations.regions), motion.segment, t, y, since)
        guards = Guards(following, labels, held, at_level, velocity_uncertainty)
        if guards.misjudged.size or (not guards.is_plain and guards.stays_zero.size):
            return None
        over = guards.violated.nonzero()[0]
        if not over.size:
            return Settled(labels, following, guards)
        if direction or may_be_spared or over.size > 1 or guards.row[over[0]] != row:
            return None
        direction = int(guards.direction[over[0]])


def settle(system: System, segment: Segment, now: Situation, uncertainty: Uncertainty) -> Settled:
    """Return the modes in which the motion goes on, with the loads of a segment.

    All rows whose relative velocity is 0 are tried held; while some force is beyond its limits, the row with the
    largest ratio of force to level is set moving in the direction of its force, ties within roundoff together. If
    other rows can hold what is beyond its level, the row carries its level instead (MODEL rule 8).

    Raises `Inconsistent` if no set of modes is consistent, and `Jammed` where drives press rows together that cannot
    give way.
    """
    q = inputs_before(system, segment, now, segment.table_regions)
    closed = _closed(system, segment, now.t, q)
    if system.dependence is not None:
        # a normal force whose terms cancel is roundoff: the motion tells whether the contact closes
        closed[system.dependence.cancelled(q, now.y)] = False
    tried, as_it_is, by_value = list[bytes](), False, False
    while True:
        try:
            found = _settled(system, segment, now, uncertainty, q, closed)
        except Inconsistent as fault:
            if (moving := _moving_on(system, segment, now, q, fault.rows)) is None:
                raise
            now = moving
            continue
        wrong = found.guards.misjudged
        # after a first try, normal forces that at once pass 0 to the right side are wrong by roundoff only
        soon_right = bool(tried) and found.guards.soon_right(wrong)
        if as_it_is or not wrong.size or soon_right or (by_value and found.guards.right_now(wrong)):
            if (rows := pressed_together(found.motion)).size:
                raise Jammed(rows)
            return found
        if by_value:
            raise Inconsistent(wrong)
        # the motion tells the signs of the normal forces that depend on it: rows that are wrong open or close
        tried.append(closed.tobytes())
        closed = closed.copy()
        closed[wrong] ^= True
        if (again := tried.count(closed.tobytes())) and system.free[wrong].all():
            # laws that never stick give no force where the normal force is 0: rows that only touch that stay closed
            closed[wrong] = as_it_is = True
        elif again > 1:
            if (moving := _moving_on(system, segment, now, q, wrong)) is not None:
                now = moving
                tried.clear()
            else:
                # their slopes gave no consistent answer: their present values decide
                closed[wrong], by_value = q[wrong] > 0, True


def _moving_on(system: System, segment: Segment, now: Situation, q: Array, rows: Indices) -> Situation | None:
    """Return the situation without rows that count as at rest, but move by more than roundoff; None if all rest.

    Where a motion dies away together with a normal force, such a velocity tells whether a row opens or closes: that of
    one of the `rows`, or of one that bodies join to it.
    """
    w, rough = _relative(system, segment, now.y, now.was, now.t, q)
    moves = np.isin(system.part_of_row, system.part_of_row[rows]) & now.touching & (np.abs(w) > rough)
    return now._replace(touching=now.touching & ~moves) if moves.any() else None


def at_rest_in_bands(system: System, loads: Loads, now: Situation) -> Situation:
    """Return the situation with those contacts at rest that have come into Karnopp's dead band.

    It changes only where inputs depend on the state: these jump with the velocities.
    """
    if not system.has_dead_bands or system.dependence is None:
        return now
    segment = loads.after(now.t)
    q = inputs_before(system, segment, now, segment.table_regions)
    at_stop = np.zeros(system.m, dtype=bool) if now.sides is None else now.sides != 0
    w, rough = _relative(system, segment, now.y, now.was, now.t, q)
    closed = _closed(system, segment, now.t, q)
    return _at_rest_in_bands(system, now, w, rough, closed, at_stop, system.drive_velocities(q))


def inputs_before(system: System, segment: Segment, now: Situation, regions: TableRegions = None) -> Array:
    """Return the inputs before the modes are known; rows that move have the friction of their velocity.

    Tables follow the lines of their `regions`; without regions, the lines at their arguments.
    """
    q = segment.at(now.t)
    if system.dependence is None:
        return q
    friction: Friction | None = None
    if system.dependence.has_heat:
        w, rough = _relative(system, segment, now.y, now.was, now.t, q)
        rests = (np.abs(w) <= rough) | _within_band(system, now, w, rough) & (now.labels is None)
        none = np.zeros(system.m, dtype=bool)
        modes = _tried_first(system, np.where(rests, 0, np.sign(w)).astype(np.int8), w, now, ~none, none)
        regions_of_rows = system.piecewise.at(now.y, q, now.regions)
        equations = equations_in(modes, system, regions_of_rows)

        def friction(row: int, w: float, normal: float, tau: float, deflection: Sequence[float]) -> float:
            held = float(now.t - now.since[row])
            return equations.friction_of(row, w, normal, held + tau, deflection) if normal > 0 else 0.0

    system.dependence.fill(q, now.y, now.t, 0.0, friction, regions=regions)
    return q


def _settled(
    system: System,
    segment: Segment,
    now: Situation,
    uncertainty: Uncertainty,
    q: Array,
    closed: Mask,
) -> Settled:
    """Return consistent modes, given the rows `closed` that can carry a force."""
    velocity_uncertainty = uncertainty.velocity_uncertainty
    at_stop = np.zeros(system.m, dtype=bool) if now.sides is None else now.sides != 0
    if system.has_stops:
        closed = closed & (~system.is_stop | at_stop)
    straight = [state for j, state in system.bristle_state.items() if not closed[j]]
    if straight:
        # bristles that nothing presses straighten at once
        now = now._replace(y=now.y.copy())
        now.y[straight] = 0.0
    w, rough = _relative(system, segment, now.y, now.was, now.t, q)
    u = system.drive_velocities(q)
    if system.has_dead_bands:
        now = _at_rest_in_bands(system, now, w, rough, closed, at_stop, u)
        w, rough = _relative(system, segment, now.y, now.was, now.t, q)
    # a row whose law does not stick is at rest only where it carries no force
    resting = _resting(system, now, np.abs(w) <= rough, w, at_stop) & (system.hard | ~closed)
    named = np.sign(w)
    if now.labels is not None and (velocity_uncertainty is not None or np.count_nonzero(closed) < closed.size):
        named, resting = _directions(now, w, closed, resting, velocity_uncertainty)
    candidates = closed & resting
    y = system.with_held(now.y, u, candidates)
    if y is not now.y:
        # rows that share a motion come to rest together, though an event may have found only one of them
        w = system.relative_velocity(y, q)
        also = closed & ~resting & (np.abs(w) <= rough)
        if np.count_nonzero(also) and (also := also & system.hard).any():
            resting |= also
            candidates = closed & resting
            y = system.with_held(now.y, u, candidates)
    labels = np.where(resting, 0, named).astype(np.int8)
    trial = _tried_first(system, labels, w, now, closed, at_stop)
    rests = (trial == 0) | (trial == OPEN) & (labels == 0)
    since = now.since if now.labels is not None else np.where(rests, now.since, now.t)
    now = now._replace(y=y, since=since)
    regions = system.piecewise.at(y, q, now.regions)
    search = Search(system, segment, now, labels, candidates, regions, velocity_uncertainty)
    motion, guards = search.run(trial)
    if (stopped := _stopped_by(motion, candidates)) is not None:
        y = system.with_held(now.y, u, motion.equations.is_held)
        now = now._replace(y=y, touching=now.touching | stopped)
        return _settled(system, segment, now, uncertainty, q, closed)
    crossed = np.zeros(system.m, dtype=bool) if velocity_uncertainty is None else now.crossed
    shown, died = label(motion, labels, w, resting, now.labels, crossed, uncertainty)
    is_open = motion.equations.open
    if is_open.size:
        # a row that held rows lock is at rest, even if it is open
        slow = (shown != 0) & (motion.equations.modes == OPEN) & (np.abs(w) <= rough)
        if np.count_nonzero(slow):
            shown = np.where(slow & motion.equations.always_locked, 0, shown).astype(np.int8)
        # the sign of a velocity that has died away is a solver's error: it is not watched
        watched = np.where(died, 0, shown).astype(np.int8)
        if np.count_nonzero(watched[is_open] != labels[is_open]):
            guards = Guards(motion, watched, search.at_rest(watched), now.at_level(system), velocity_uncertainty)
    if system.piecewise.count:
        shown = system.piecewise.shown(shown, motion.equations.regions)
    return Settled(shown, motion, guards)


def _stopped_by(motion: Motion, candidates: Mask) -> Mask | None:
    """Return the rows that the search holds beside its candidates, and the rows in motion that these lock.

    None if no row in motion is locked.
    """
    equations = motion.equations
    caught: Mask = equations.is_held & ~candidates
    if not np.count_nonzero(caught):
        return None
    locked = (np.abs(equations.modes) == 1) & motion.system.hard & equations.always_locked
    return caught | locked if locked.any() else None


def _tried_first(system: System, labels: Modes, w: Array, now: Situation, closed: Mask, at_stop: Mask) -> Modes:
    """Return the modes in which all rows at rest are held that can carry a force."""
    trial = labels
    if not system.all_hard:
        trial = np.where(system.hard, trial, _slip_states(system, w, now)).astype(np.int8)
    if np.count_nonzero(closed) < closed.size:
        trial = np.where(closed, trial, OPEN).astype(np.int8)
    if system.piecewise.count:
        trial = np.where(system.is_gap | system.is_stop & ~at_stop, APART, trial).astype(np.int8)
    return trial


def _resting(system: System, now: Situation, slow: Mask, w: Array, at_stop: Mask) -> Mask:
    """Tell which rows have a relative velocity of 0, or may not move."""
    resting = now.touching | slow
    if not system.all_friction:
        # a one-way clutch cannot turn forward: a velocity forward is roundoff
        resting |= system.is_tie | system.is_one_way & (w > 0)
    return np.where(system.is_stop, at_stop, resting) if system.has_stops else resting


def _at_rest_in_bands(
    system: System, now: Situation, w: Array, rough: Array, closed: Mask, at_stop: Mask, u: Array
) -> Situation:
    """Bring contacts to rest that have come into Karnopp's dead band, except those that rows at rest lead."""
    moving = closed & _within_band(system, now, w, rough)
    if not moving.any():
        return now
    resting = closed & ~moving & _resting(system, now, np.abs(w) <= rough, w, at_stop)
    held, led = resting & (system.hard | ~system.is_friction), np.zeros(system.m, dtype=bool)
    y = system.with_held(now.y, u, held)
    for j in moving.nonzero()[0].tolist():
        G = system.G[[j]]
        left = row_maxima(G @ system.balance(held).T)
        led[j] = left[0] <= ROUNDOFF * row_maxima(G)[0]
        if led[j]:
            continue
        held[j] = True
        following = system.with_held(now.y, u, held)
        # a contact whose rest would turn a one-way clutch forward moves on, too
        led[j] = bool((system.is_one_way & (system.relative(following[: system.n], u) > rough)).any())
        held[j] = not led[j]
        y = y if led[j] else following
    return now._replace(y=y, touching=now.touching & ~led)


def _within_band(system: System, now: Situation, w: Array, rough: Array) -> Mask:
    """Tell which rows Karnopp's dead band stops, if nothing leads them."""
    limit = np.where(system.hard, system.laws.rests_below, 0.0)
    within = (limit > 0) & (np.abs(w) > rough) & ((np.abs(w) <= (1 + AT_BAND) * limit) | now.touching)
    return within & (now.touching | ~now.moves_on) if now.moves_on is not None else within


def _directions(
    now: Situation, w: Array, closed: Mask, resting: Mask, velocity_uncertainty: Array | None
) -> tuple[Array, Mask]:
    """Return the signs of the relative velocities, and which rows are at rest, by what the rows showed before."""
    assert now.labels is not None
    # nothing holds an open row: a velocity that dies away has not come to 0 until an event finds it there, or it jumps
    kept = ~closed & (now.labels != 0) & ~now.touching
    kept &= now.labels * w > (0.0 if velocity_uncertainty is None else -velocity_uncertainty)
    resting = resting & ~kept
    if velocity_uncertainty is not None:
        # a velocity that is beyond 0 by no more than a solver's errors has not passed it
        kept |= (np.abs(now.labels) == 1) & ~now.touching & ~resting & (np.abs(w) <= velocity_uncertainty)
    return np.where(kept, now.labels, np.sign(w)), resting


def _slip_states(system: System, w: Array, now: Situation) -> Array:
    """Return the modes of contacts with a pre-slip velocity: the binary slip state of eq. (4), with its memory."""
    speed, sign = np.abs(w), np.sign(w)
    slipped = system.starts_slipping if now.labels is None else np.abs(now.labels) == 1
    limit = np.where(slipped, system.laws.rests_below, system.laws.slips_beyond)
    slips = (speed > limit) | (now.fired & ~slipped & (speed > 0.5 * limit))
    slips &= ~(now.fired & slipped)
    return np.where(system.free, FREE, np.where(slips, sign, 0.0))


def _closed(system: System, segment: Segment, t: float, q: Array) -> Mask:
    """Tell which rows can carry a force now or just after now."""
    presses = q[: system.m] > 0
    if np.count_nonzero(presses) < presses.size:
        # a normal force that is 0 now, or below by roundoff, may begin to press, or only touch 0
        presses |= (segment.just_after(t, system.m) > 0) & ~system.pressed
    if not system.all_friction:
        presses |= ~system.is_friction
    return np.asarray(presses & system.alive)


def _relative(system: System, segment: Segment, y: Array, was: Array | None, t: float, q: Array) -> tuple[Array, Array]:
    """Return each row's relative velocity and the roundoff of the largest speed that adds up in it.

    A body that comes to rest has the roundoff of the speed that it had. Where a drive accelerates, the roundoff of the
    time is an error of its velocity, however slow it is at the moment. A sine that is 0 has the roundoff of its phase.
    """
    n = system.n
    speed = np.abs(y[:n])
    if was is not None:
        speed = np.maximum(speed, was[:n])
    largest = float(speed.max(initial=0.0))
    found = row_maxima(system.abs_G * speed)
    if system.drives:
        u = np.abs(system.drive_velocities(q)) + np.abs(system.drive_accelerations(q) * t)
        if segment.has_sines:
            u += _OF_PHASE * system.drive_velocities(np.abs(segment.amplitudes))
        largest = max(largest, float(u.max()))
        found = np.maximum(found, row_maxima(system.abs_D * u))
    return system.relative_velocity(y, q), ROUNDOFF * np.maximum(found, ROUNDOFF * largest)
