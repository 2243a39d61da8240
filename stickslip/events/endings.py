"""What happened by the end of a path: pure functions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from stickslip.equations.guards.at_start import FINEST_ROUNDOFF, ROUNDOFF, TIME
from stickslip.equations.guards.guards import FULLY, Guards
from stickslip.equations.loads.loads import Loads
from stickslip.equations.mode_equations import OPEN
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.events.impact import SAME, Struck, roundoff_of_velocities, struck
from stickslip.model.arrays import Array, Indices, Mask, Modes

# Guards, as parts of their scales: differences up to which they tie, and values up to which they are near 0.
_TIE, _NEAR = 1e-13, 1e-6
_NO_SIZE = 1e-200

_AT_STOP = 1e-12  # part of the majorant of a stretch within which it is at a limit
_IN_NO_TIME = 1e-13  # part of the time ahead below which a flight is too short to be resolved

_CERTAIN = 10.0  # multiple of its roundoff from which on the sign of a stretch is certain

# A velocity that arrives at 0, and does not die away, has come from more than this multiple of its roughness.
_AT_A_RATE = 1e3


class AtLimit(NamedTuple):
    """What has come to its limit at the end of a path."""

    touching: Mask  # (m,): rows whose relative velocity has come to 0
    fired: Mask  # (m,): rows whose guard has come to 0
    crossed: Indices  # borders of regions that have been reached


class EndState(NamedTuple):
    """Where a motion has come to at its end."""

    t: float  # time in s; at a break of the loads the break itself
    tau: float  # time in s since the start of the motion, as it was added up
    y: Array  # (size,)
    largest: Array  # (size,): bounds of the sizes of the states along the motion


class StepErrors(NamedTuple):
    """How much a solver may err in the states (size,) in one step."""

    least: Array  # in states that are 0
    most: Array  # in the states as they are now


class Jump(NamedTuple):
    """What impacts and jumping drives do at an instant."""

    parted: Mask  # (m,): rows whose relative velocity jumps
    y: Array  # (size,): the state after the jump
    sides: Modes  # (m,): +1 where a stop rests at its upper limit then, -1 at its lower one
    hit: Mask  # (m,): stops that have been hit
    impact: Struck | None  # what impulses did; None for none
    # (m,): below which relative velocities are roundoff after the jump, by the speeds before and after it; None where
    # no velocity jumps
    roundoff: Array | None = None


def alone_at_limit(guards: Guards, path: Path) -> tuple[int, int] | None:
    """Return the row that sticks or lets go where no other guard is near 0, and the direction in which it is pushed.

    The direction is 0 for a row that moved. None where more has to be looked at than this row.
    """
    if not path.hit or path.touched is not None:
        return None
    values, part = _at_end(guards, path)
    near, uncertain = part <= _NEAR, guards.velocity_uncertainty
    if uncertain is not None:
        near |= guards.is_velocity & (values <= guards.uncertain)
    if np.count_nonzero(near) != 1:
        return None
    i = int(near.argmax())
    if path.guard is not None and i != path.guard:
        return None
    if uncertain is not None and i in guards.passing and not _has_passed(values[i], guards.leeway[i]):
        return None
    return guards.row_and_direction(i)


def _at_end(guards: Guards, path: Path) -> tuple[Array, Array]:
    """Return the guards at the end of a path, and as parts of their scales."""
    values, size = guards.at_end(path)
    return values, values / np.where(size > _NO_SIZE, size, 1.0)


def _has_passed(velocity: Any, leeway: Any) -> Any:
    """Tell whether a velocity is at 0, or has passed it: one that is beyond 0 by less than its leeway has not."""
    return (velocity >= (FULLY - 1) * leeway) | (velocity <= -FULLY * leeway)


def _missed(motion: Motion, path: Path) -> Array:
    """Return how much relative velocities (m,) change at the end of a path within the roundoff of the time."""
    tau = float(path.taus[-1])
    return np.asarray(TIME * tau * np.abs(motion.relative_accelerations(tau, path.last)))


def _die_away(motion: Motion, guards: Guards, path: Path, values: Array, some: Mask) -> Mask:
    """Tell which of some guards are velocities that die away: they are small, but do not come to 0 at their rate."""
    some = some & guards.is_velocity & (values > 0)
    if path.guard is not None:
        some[path.guard] = False
    if not some.any():
        return some
    tau = float(path.taus[-1])
    falls = -guards.rows.sign * motion.relative_accelerations(tau, path.last)[guards.row]
    return np.asarray(some & (falls > 0) & (falls * tau <= _AT_A_RATE * values))


def at_limit(motion: Motion, guards: Guards, path: Path, relaxed_ones: list[int]) -> AtLimit:
    """Return what has just come to its limit."""
    m, crossed = motion.system.m, np.empty(0, dtype=np.intp)
    touching, fired = np.zeros((2, m), dtype=bool)
    # if the motion ends at once at a border of a table, rows that have just begun to move are at rest but for roundoff
    touching[guards.still_at_rest(float(path.taus[-1]))] = True
    if relaxed_ones:
        touching[relaxed_ones] = fired[relaxed_ones] = True
    if path.touched is not None:
        touching[path.touched] = fired[path.touched] = True
    if path.hit:
        # rows that tie within roundoff go together; forces and velocities are compared as parts of their scales
        values, part = _at_end(guards, path)
        at = part <= max(0.0, float(part.min())) + _TIE
        at &= ~_die_away(motion, guards, path, values, at)
        if (part.min() if path.guard is None else part[path.guard]) > _NEAR:
            # The guard that came to 0 is not small: it left 0 so short a time before that it is still roundoff, or its
            # value is the roundoff of what it compares.
            back = guards.is_roundoff_at(float(path.taus[-1]))
            at = back if back.any() else guards.nearest(part, path)
        if guards.velocity_uncertainty is not None:
            short = guards.passing[~_has_passed(values[guards.passing], guards.leeway[guards.passing])]
            if short.size:
                # a velocity that has missed 0 by no more than the roundoff of the time is at 0
                missed = _missed(motion, path)[guards.row[short]]
                at[short] &= _has_passed(values[short] + missed, guards.leeway[short])
        # a row whose normal force has come to 0 has not come to its own limit
        fired[guards.row[at & ~guards.is_border & ~guards.is_normal]] = True
        touching[guards.row[at & guards.is_velocity]] = True
        crossed = motion.equations.borders[at[guards.is_border]]
    return AtLimit(touching, fired, crossed)


def at_stops(
    system: System,
    y: Array,
    q: Array,
    before: Modes | None = None,
    largest: Array | None = None,
    crossed: Indices | tuple[()] = (),
    is_exact: bool = False,
) -> tuple[Modes, Mask]:
    """Return at which limits stops are, and which of them have come there only now.

    `before` are the modes that rows showed, None at the start. `crossed` are borders that have been found at 0. The
    sides are +1 at the upper limit, -1 at the lower one, and 0 elsewhere. Where a motion `is_exact`, a stop strikes
    where its guard comes to 0, or together with another stop: one a little before its limit has not struck yet.
    """
    sides = np.zeros(system.m, dtype=np.int8)
    if not system.has_stops:
        return sides, np.zeros(system.m, dtype=bool)
    functions = system.piecewise
    upper, lower, size = functions.limits(y, q, y if largest is None else largest)
    of, row = functions.is_stop, functions.row[functions.is_stop]
    found = [border for border in crossed if of[functions.owner[border]]]
    near = (FINEST_ROUNDOFF if is_exact and not found else _AT_STOP) * size
    sides[row] = np.where(upper <= near, 1, np.where(lower <= near, -1, 0))[of]
    for border in found:
        sides[functions.row[functions.owner[border]]] = 1 if functions.beyond[border] == 1 else -1
    was = np.zeros(system.m, dtype=bool) if before is None else system.is_stop & (np.abs(before) == 1)
    if before is not None:
        sides[was] = before[was]
    return sides, (sides != 0) & ~was


def at_stops_at_start(system: System, y: Array, q: Array, t: float) -> Modes:
    """Return at which limits stops are as a run starts: those nearer to one than the roundoff of the time are at it."""
    size, late, u = np.abs(y), TIME / _AT_STOP * abs(t), system.drive_velocities(q)
    size[system.moved_state] += late * np.abs(y[system.moved])
    size[system.carried_state] += late * np.abs(u[system.carried])
    return at_stops(system, y, q, largest=size)[0]


def jumped(
    motion: Motion,
    loads: Loads,
    end: EndState,
    labels: Modes,
    crossed: Indices,
    margin: Array,
    errors: StepErrors | None,
) -> Jump:
    """Return what impacts and jumping drives do at the end of a motion.

    Ties, one-way clutches and stops hand impulses on; friction does not, because its force is finite. Stops that would
    rebound with less than their `margin` stay at their limit. So do stops whose flight would be roundoff, or lost in
    the `errors` of a solver, which are None for exact engines.
    """
    system, n, (t, tau, y, largest) = motion.system, motion.system.n, end
    if not (system.drives or system.has_stops):
        none = np.zeros(system.m, dtype=bool)
        return Jump(none, y, np.zeros(system.m, dtype=np.int8), none, None)
    q, q_before = loads.after(t).at(t), motion.segment.at(motion.t + tau)
    before, after = system.drive_velocities(q_before), system.drive_velocities(q)
    size = np.abs(before) + np.abs(after)
    # where a drive comes to rest in a corner of its velocity, the roundoff of the time makes a small jump
    rough = ROUNDOFF * (abs(t) + motion.horizon) * np.abs(system.drive_accelerations(q_before))
    jump = np.where(np.abs(after - before) > np.maximum(SAME * size, rough), after - before, 0.0)
    sides, new = at_stops(system, y, q, labels, largest, crossed, errors is None)
    w = system.relative(y[:n], before)
    hit = new & (sides * w > 0)
    if not (jump.any() or hit.any()):
        sides[new & (sides * w < -margin)] = 0
        return Jump(np.zeros(system.m, dtype=bool), y, sides, hit, None)
    driven = SAME * (system.abs_D @ np.maximum(np.abs(before), np.abs(after)))
    if not hit.any() and (system.is_friction | system.is_gap).all():
        roundoff = SAME * (system.abs_G @ np.abs(y[:n])) + driven
        return Jump(np.asarray(system.D @ jump != 0), y, sides, hit, None, roundoff)
    if hit.any():
        margin = np.maximum(margin, _slowest_flight(motion, end, q, hit, loads.after(t).stop - t, errors))
    found = struck(system, y[:n], before, after, sides, hit, margin)
    change = np.abs(system.relative(found.v - y[:n], jump))
    fastest = np.maximum(np.abs(found.v), np.abs(y[:n]))
    parted = change > roundoff_of_velocities(system, fastest, before, after)
    y = y.copy()
    y[:n] = found.v
    # rebounds slower than the margin do not happen
    sides[sides * system.relative(found.v, after) < -margin] = 0
    return Jump(parted, y, sides, hit, found, SAME * (system.abs_G @ fastest) + driven)


def _slowest_flight(
    motion: Motion, end: EndState, q: Array, hit: Mask, ahead: float, errors: StepErrors | None
) -> Array:
    """Return the speeds (m,) below which stops that are hit come back before their flight can be resolved.

    All rows of a part of the scene have the largest of its speeds. At its farthest a stop is ``v^2 / 2 a`` away, where
    a is the sum of the sizes of the accelerations of its ends. A solver must not lose this distance in its `errors`, an
    exact engine not in roundoff. For an exact engine it is enough, too, if the speed takes the stop beyond roundoff
    within the time `ahead`.
    """
    system, functions, n = motion.system, motion.system.piecewise, motion.system.n
    pace, speeds = system.abs_G @ np.abs(motion.rate(end.tau, end.y)[:n]), system.abs_G @ end.largest[:n]
    if system.drives:
        pace = pace + system.abs_D @ np.abs(system.drive_accelerations(q))
        speeds = speeds + system.abs_D @ np.abs(system.drive_velocities(q))
    _, _, size = functions.limits(end.y, q, end.largest)
    some = functions.is_stop & hit[functions.row]
    if errors is not None:
        # of a stop that is hit the last flight may have been as low as this one
        none = np.zeros_like(errors.least), np.zeros_like(q)
        _, _, lost = functions.limits(*none, errors.least)
        # a stop that gains speed in a flight lower than a step may err gains it by errors: its rebounds would not end
        _, _, most = functions.limits(*none, errors.most)
        lost = np.where(_gains(motion, end, q, most), most, lost)
        # the roundoff of the time is an error of the place at which a guard finds a stop, too
        late = TIME * abs(end.t) * speeds[functions.row]
        rough = 2.0 * (np.maximum(ROUNDOFF * size, lost) + late)[some]
        slowest = np.sqrt(rough * pace[functions.row[some]])
    else:
        rough, brakes = 2.0 * FINEST_ROUNDOFF * size[some], pace[functions.row[some]]
        slowest = np.minimum(np.sqrt(rough * brakes), _CERTAIN * rough / ahead)
        # nor must the flight be too short to be resolved in time
        slowest = np.maximum(slowest, _IN_NO_TIME * ahead * brakes)
    part = system.part_of_row
    in_parts = np.zeros(part.max(initial=0) + 1)
    np.maximum.at(in_parts, part[functions.row[some]], slowest)
    return np.asarray(in_parts[part])


def _gains(motion: Motion, end: EndState, q: Array, near: Array) -> Mask:
    """Tell which stops began a motion within `near` of a limit, and are faster at its end than they were then."""
    system, functions, q0 = motion.system, motion.system.piecewise, motion.start_inputs
    upper, lower, _ = functions.limits(motion.y, q0, motion.y)
    left, back = system.relative_velocity(motion.y, q0), system.relative_velocity(end.y, q)
    return np.asarray((np.minimum(upper, lower) <= near) & (np.abs(back) > np.abs(left))[functions.row])


def open_from_here(system: System, modes: Modes, q: Array) -> Mask:
    """Tell which rows are open, or open as a motion ends and the inputs become `q`."""
    moves = (np.abs(modes) == 1) & system.is_friction & ~system.pressed
    return np.asarray((modes == OPEN) | moves & (q[: system.m] <= 0))


def landed(system: System, modes: Modes, jump: Jump, q: Array) -> Mask:
    """Tell which open rows have jumped to relative velocity 0, with the inputs `q` from then on."""
    found: Mask = jump.parted & system.is_friction & (modes == OPEN)
    if jump.roundoff is None or not found.any():
        return found
    w = system.relative(jump.y[: system.n], system.drive_velocities(q))
    return np.asarray(found & (np.abs(w) <= jump.roundoff))


def arrived(motion: Motion, path: Path, labels: Modes, some: Mask, uncertain: Array | None) -> Mask:
    """Tell which of some rows come to rest at the end of a path, where a drive stops or another row is caught.

    The velocity of such a row comes to 0 with a rate; a velocity that dies away has no rate left by then.
    """
    system, n, tau = motion.system, motion.system.n, float(path.taus[-1])
    if not some.any():
        return some
    q = motion.inputs(tau, path.last)
    rate, speeds = system.G @ motion.both(tau, path.last, q)[:n], system.abs_G @ path.largest[:n]
    if system.drives:
        acceleration = system.drive_accelerations(q)
        reached = np.abs(system.drive_velocities(q)) + np.abs(acceleration) * (motion.t + tau)
        rate, speeds = rate + system.D @ acceleration, speeds + system.abs_D @ reached
    w = system.relative_velocity(path.last, q)
    return np.asarray(some & arrives(w, rate, tau, labels, ROUNDOFF * speeds, uncertain))


def arrives(
    w: Array,
    rate: Array,
    duration: float | Array,
    labels: Modes,
    rough: float | Array,
    uncertain: Array | None = None,
) -> Mask:
    """Tell which velocities are 0, but for what is `rough`, and have come there at their rate from far more than that.

    Velocities that are not as near 0, but within what is `uncertain`, have to come from far more than `uncertain`.
    """
    size = np.abs(w)
    left = rough if uncertain is None else np.where(size <= rough, rough, np.maximum(rough, uncertain))
    comes = (labels * rate < 0) & (np.abs(rate) * duration > _AT_A_RATE * left)
    return np.asarray(comes & (size <= left))


def shown_at_end(motion: Motion, path: Path, labels: Modes) -> Modes:
    """Return the modes that rows show at the end of a path: laws without modes follow their velocity."""
    free = motion.equations.free
    if not free.size:
        return labels
    w = motion.watched(float(path.taus[-1]), path.last)[: motion.system.m]
    shown = labels.copy()
    shown[free] = motion.system.sign_of(w)[free]
    return shown
