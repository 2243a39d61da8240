"""Where a motion has no derivative: where a rise of a parameter has another effect than a fall.

Each function looks at one instant, or along one motion, and returns directions with the reason why.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy

from stickslip.equations.balance import component_numbers
from stickslip.equations.guards.at_start import NEVER
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.events.search import Search
from stickslip.events.situation import Inconsistent, Situation
from stickslip.model.arrays import Array, Modes
from stickslip.results.pieces import Piece
from stickslip.studies.derivatives.nearby import REST, Nearby, total
from stickslip.studies.derivatives.varied import VariedPiece
from stickslip.studies.derivatives.varied_guards import TIE, VariedGuards

_LOOKS = 8  # number of times in each step at which all guards are computed

# Where a guard dips below the first part of its size, its minimum is searched for. A minimum below the second part
# counts as 0.
_NEAR, _TOUCH = 1e-2, 1e-9

_RISE = 1e-13  # part of its size by which a guard has to rise on both sides of a touch
_AT_REST = 1e-9  # part of the speeds below which a row counts as at rest where another row comes to rest


def at_start(nearby: Nearby, piece: Piece, motion: Motion, S: Array, since: Array) -> Iterator[tuple[int, str]]:
    """Find directions that move forces off their levels at the start, or rows off rest that begin to slip there."""
    times = np.zeros(nearby.count)
    for k, label in _off_levels(VariedGuards(nearby, piece, motion), S, since, times):
        yield k, f"{label} starts at its level: the derivatives to the two sides differ"
    for k, name in _off_rest(nearby, motion, S, times):
        label = f"{name!r} starts at relative velocity 0"
        yield k, f"{label} and begins to slip: the derivatives to the two sides differ"


def after_impact(nearby: Nearby, motion: Motion, S: Array, times: Array) -> Iterator[tuple[int, str]]:
    """Find directions that move rows off rest that an impact brings there exactly, and that slip on."""
    for k, name in _off_rest(nearby, motion, S, times):
        label = f"{name!r} has relative velocity 0 after an impact"
        yield k, f"{label} and begins to slip: the derivatives to the two sides differ"


def _off_rest(nearby: Nearby, motion: Motion, S: Array, times: Array) -> Iterator[tuple[int, str]]:
    """Find directions that move rows off rest that begin to slip there, with the names of the rows.

    The time at which the motion starts changes by `times`.
    """
    slip = motion.equations.slip
    rows = slip[nearby.at_rest(motion)[slip]]
    if not rows.size:
        return
    slopes = nearby.slopes_at(_relative, motion, np.zeros((nearby.system.m, nearby.count)), 0.0, motion.y, S)
    slopes += np.outer(motion.relative_accelerations(0.0, motion.y), times)
    scale = _speed_slopes(nearby, S, motion.rate(0.0, motion.y), times)
    for k, i in _moved(slopes[rows], TIE * scale):
        yield k, nearby.system.rows[rows[i]].name


def off_hold_at_start(nearby: Nearby) -> Iterator[tuple[int, str]]:
    """Find directions that move rows off rest at the start, of which one then goes on."""
    motion, limits = nearby.motion_of(0), TIE * nearby.state_sizes[0] / nearby.sizes
    for k, slopes in enumerate(_relative_at_start(nearby).T):
        if name := goes_on(motion, slopes, limits[k]):
            yield k, f"{name!r} starts at rest, and near by it slips on: it holds more at rest than in motion"


def goes_on(motion: Motion, slopes: Array, limit: float) -> str:
    """Return the name of a held row that would not come to rest again if rows moved with some relative velocities.

    They move with small ones that have these `slopes`, or with the opposite ones; slopes up to the `limit` are none.
    The name is empty if there is no such row. A contact may hold more at rest than in motion.
    """
    system, equations = motion.system, motion.equations
    held = equations.held[system.is_friction[equations.held]]
    rows = held[np.abs(slopes[held]) > limit]
    for side in (1, -1) if rows.size else ():
        modes = equations.modes.copy()
        modes[rows] = side * np.sign(slopes[rows])
        near = Motion(equations_in(modes, system, equations.regions), motion.segment, motion.t, motion.y, motion.since)
        along = near.relative_accelerations(0.0, near.y)[rows] * modes[rows]
        rough = _TOUCH * np.asarray(system.abs_G[rows] @ near.rate_majorants()[: system.n])
        if (on := (along >= -rough) & ~near.equations.locked(rows)).any():
            return str(system.rows[rows[on.argmax()]].name)
    return ""


def at_dwells(nearby: Nearby) -> Iterator[tuple[int, str]]:
    """Find directions that move rows off rest at the start whose level rises while they rest.

    Whether the parameter rises or falls, such a row then slips for a moment before it rests.
    """
    trajectory, system = nearby.trajectory, nearby.system
    piece = trajectory.pieces[0]
    rows = system.dwelling[(piece.modes == 0)[system.dwelling]]
    for k, i in _moved(_relative_at_start(nearby)[rows], TIE * nearby.state_sizes[0] / nearby.sizes):
        yield k, f"{system.rows[rows[i]].name!r} starts at rest, and to both sides its dwell begins later"


def at_closed_stops(nearby: Nearby, sides: Modes) -> Iterator[tuple[int, str]]:
    """Find directions in which stops that start closed at rest would part or, for the opposite change, hit."""
    system, t = nearby.system, nearby.trajectory.span.start
    w = system.relative_velocity(system.at_start(), nearby.trajectory.loads.after(t).at(t))
    rows = (system.is_stop & (sides != 0) & (np.abs(w) <= REST * nearby.state_sizes[0])).nonzero()[0]
    for k, i in _moved(_relative_at_start(nearby)[rows], TIE * nearby.state_sizes[0] / nearby.sizes):
        yield k, f"{system.rows[rows[i]].name!r} starts closed, and near by it parts to one side and hits to the other"


def _relative_at_start(nearby: Nearby) -> Array:
    """Return the derivatives of the relative velocities at the start, before those of held rows are made 0."""
    system, piece = nearby.system, nearby.trajectory.pieces[0]
    slopes = np.empty((system.m, nearby.count))
    for k, near_ones in enumerate(nearby.near_ones):
        velocities = [
            weight * near.relative_velocity(piece.y, loads.after(piece.t).at(piece.t))
            for weight, near, loads in near_ones
        ]
        slopes[:, k] = system.G @ nearby.directions[k].y[: system.n] + total(velocities)
    return slopes


def at_loops(nearby: Nearby, motion: Motion) -> Iterator[tuple[int, str]]:
    """Find directions in which rows that hold the same motion contradict each other in scenes near by."""

    def known(one: Motion) -> tuple[int, bool]:
        # drives that move evenly tear no rows, but near by these may contradict each other all the same
        return one.equations.dependent.size, one.system.balance(one.equations.is_held).parting is None

    for k in range(nearby.count):
        if any(known(near) != known(motion) for _, near in nearby.near(motion, k)):
            yield k, "rows hold the same motion, and near by they contradict each other"


def at_borders(nearby: Nearby, number: int, motion: Motion, varied: VariedPiece) -> Iterator[tuple[int, str]]:
    """Find directions that move gaps off a limit at which they stay during a motion."""
    if not nearby.system.is_gap.any():
        return
    piece = nearby.trajectory.pieces[number]
    own = VariedGuards(nearby, piece, motion)
    stay = (own.guards.is_border & (own.guards.order == NEVER)).nonzero()[0]
    at = stay[[own.is_continuous(i) for i in stay.tolist()]]
    middle, none = 0.5 * piece.end, np.zeros(nearby.count)
    y, S = motion.exact(middle, piece.kept_path.state(middle)), varied.at(np.array([middle]))[:, 0]
    for i, k in own.moved(at, middle, y, S, varied.since_change, none):
        yield k, f"{own.label(i)} stays at a limit: the derivatives to the two sides differ"


def at_stops(nearby: Nearby, motion: Motion, S: Array, sides: Modes) -> Iterator[tuple[int, str]]:
    """Find directions that move stops off a limit at which they start, or beyond it."""
    system = nearby.system
    if not sides.any():
        return
    functions, slopes = system.piecewise, nearby.border_slopes(motion.y, motion.loads(0.0), S)
    on_side = sides[functions.row[functions.owner]]
    limit = functions.is_stop[functions.owner] & (np.where(functions.beyond == 1, 1, -1) == on_side)
    borders = limit.nonzero()[0]
    for k, i in _moved(slopes[borders], TIE / nearby.sizes):
        label = functions.labels[functions.owner[borders[i]]]
        yield k, f"{label} starts at its limit: the derivatives to the two sides differ"


def at_corners(nearby: Nearby, number: int, motion: Motion, varied: VariedPiece) -> Iterator[tuple[int, str]]:
    """Find directions that move the argument of a table off a corner at which it stays during a motion."""
    piece, dependence = nearby.trajectory.pieces[number], nearby.system.dependence
    if dependence is None or not dependence.tables or piece.end <= 0:
        return
    x = nearby.looked_up(number, np.linspace(0.1, 0.9, 5))
    for i, region in enumerate(motion.table_regions or ()):
        for corner in dependence.borders(i, region):
            if np.abs(x[i] - corner).max() > _TOUCH * (abs(corner) + np.abs(x[i]).max() or 1.0):
                continue
            slopes = nearby.slopes_along(Motion.looked_up, number, varied, np.array([0.5 * piece.end]))[i, 0]
            for k, _ in _moved(slopes[None], TIE * abs(corner or 1.0) / nearby.sizes):
                yield k, f"a table stays at its corner {corner:g}"


def at_rise_from_nothing(nearby: Nearby, number: int, motion: Motion) -> Iterator[tuple[int, str]]:
    """Find directions that press a contact which slides with normal force 0, for one sign of the change only."""
    system, piece = nearby.system, nearby.trajectory.pieces[number]
    path = piece.kept_path
    taus = piece.end * np.array([0.5, 1.0])
    loads, y = motion.loads(taus), path.at(taus).T
    slides = np.abs(system.relative_velocity(y, loads)).max(axis=1) > REST * nearby.state_sizes[0]
    rows = (system.is_friction & ~system.pressed & slides & (loads[: system.m, 0] == 0)).nonzero()[0]
    t = piece.t + taus[0]
    for k, near_ones in enumerate(nearby.near_ones):
        for j in rows.tolist():
            if any(nearby.segment_after(piece.t, own).at(t)[j] for _, _, own in near_ones):
                name = system.rows[j].name
                yield k, f"the normal force of {name!r} is 0, and near by it is not, but to one side only"
                break


def at_touches(nearby: Nearby, number: int, motion: Motion, varied: VariedPiece) -> Iterator[tuple[int, str, float]]:
    """Find directions that move guards which touch 0 without crossing it, and the local times of these touches.

    For one sign of the change such a guard crosses 0, and there is an event; for the other there is none.
    """
    piece = nearby.trajectory.pieces[number]
    path = piece.kept_path
    if piece.end <= 0 or not motion.equations.guards.size:
        return
    own = VariedGuards(nearby, piece, motion)
    guards = own.guards
    parts = np.linspace(0.0, 1.0, _LOOKS + 1)[:-1]
    taus = np.append((path.taus[:-1, None] + np.diff(path.taus)[:, None] * parts).ravel(), piece.end)
    g = guards.values(taus, motion.exact(taus, path.at(taus).T))
    size = own.sizes(path)[0]
    inner = g[:, 1:-1]
    low = (inner <= g[:, :-2]) & (inner < g[:, 2:]) & (inner < _NEAR * size[:, None])
    for i, at in np.argwhere(low).tolist():
        if guards.order[i] == NEVER or own.is_continuous(i):
            continue

        def value(tau: float, i: int = i) -> float:
            y = motion.exact(tau, path.at(np.array([tau]))[0])
            return float(guards.values(tau, y)[i])

        bounds = (taus[at], taus[at + 2])
        found = scipy.optimize.minimize_scalar(value, bounds=bounds, method="bounded", options={"xatol": 1e-12})
        # Where a guard is small all along, as between the last rebounds of a stop, roundoff makes minima. So it has to
        # be larger on both sides of a touch.
        around = min(float(g[i, : at + 1].max()), float(g[i, at + 2 :].max()))
        if found.fun <= min(_TOUCH * size[i], 0.5 * around) and around > _RISE * size[i]:
            tau = float(found.x)
            slopes = nearby.slopes_along(own.raw, number, varied, np.array([tau]))[:, 0]
            for _, k in own.moving(np.array([i]), slopes):
                yield k, f"{own.label(i)} grazes: its guard touches 0 without crossing it", tau


def at_break(
    nearby: Nearby, piece: Piece, motion: Motion, S: Array, since: Array, times: Array
) -> Iterator[tuple[int, str]]:
    """Find directions in which an event that falls on a break of a load would come before or after it."""
    path = piece.kept_path
    own = VariedGuards(nearby, piece, motion)
    if not own.guards.size:
        return
    tau, y = float(path.taus[-1]), path.last
    near = own.guards.values(tau, y) <= _TOUCH * own.sizes(path)[0]
    at = (near & (own.guards.order != NEVER)).nonzero()[0]
    for i, k in own.moved(at, tau, y, S, since, times):
        yield k, f"an event of {own.label(i)} falls on a break of a load"


def beyond_break(
    nearby: Nearby, number: int, motion: Motion, S: Array, since: Array, times: Array
) -> Iterator[tuple[int, str]]:
    """Find directions in which a force that is exactly at its level on a break would be beyond or below the level."""
    piece, following = nearby.trajectory.pieces[number : number + 2]
    path = piece.kept_path
    if not np.any(piece.modes == 0):
        return
    segment = nearby.motion_of(number + 1).segment
    equations = equations_in(piece.modes, nearby.system, piece.regions)
    held = Motion(equations, segment, following.t, path.last, piece.since)
    y = held.exact(0.0, path.last)
    moved = S + np.outer(motion.rate(float(path.taus[-1]), path.last) - held.rate(0.0, y), times)
    own = VariedGuards(nearby, piece, held)
    for k, label in _off_levels(own, moved, since, times):
        yield k, f"{label} comes to its level on a break of a load"
    yield from _ties(nearby, piece, own, moved, since, times)


def _ties(
    nearby: Nearby, piece: Piece, own: VariedGuards, S: Array, since: Array, times: Array
) -> Iterator[tuple[int, str]]:
    """Find directions in which one of several contacts that a jump of a load overloads equally lets go first.

    A direction counts only if the modes that follow depend on which contact lets go first. `own` are the guards of the
    motion in the modes before the jump.
    """
    system, guards, rows, held = nearby.system, own.guards, own.guards.rows, own.guards.motion
    is_held = rows.is_force & (system.is_friction & (held.equations.modes == 0))[guards.row]
    force = -rows.sign * held.first.z[0][rows.source]
    level = guards.start[0] + force
    # a row without a level lets go at once, whatever the others do
    over = (is_held & (guards.start[0] < -_TOUCH * guards.scale) & (level > 0)).nonzero()[0]
    if over.size < 2:
        return

    def ratios(motion: Motion, taus: Array, y: Array) -> Array:
        force = -rows.sign[over, None] * motion.watched(taus, y)[rows.source[over]]
        return np.asarray(force / (own.raw(motion, taus, y)[over] + force))

    y, ratio = held.exact(0.0, held.y), force[over] / level[over]
    slopes = nearby.slopes_at(ratios, held, since, 0.0, y, S) + np.outer(nearby.falls(ratios, held, 0.0, y), times)
    part = component_numbers(system.G[guards.row[over]])
    for number_of_part in np.unique(part).tolist():
        mine = (part == number_of_part).nonzero()[0]
        tied = mine[ratio[mine] >= ratio[mine].max() * (1 - _TOUCH)]
        off = np.ptp(slopes[tied], axis=0) > TIE * ratio[tied[0]] / nearby.sizes
        first = [(int(guards.row[i]), int(guards.direction[i])) for i in over[tied]]
        if not off.any() or len({_after_one(piece, held, *one) for one in first}) == 1:
            continue
        names = " and ".join(repr(system.rows[j].name) for j, _ in first)
        for k in off.nonzero()[0].tolist():
            yield k, f"a jump of a load overloads {names} equally, and near by one lets go before the others"


def _after_one(piece: Piece, held: Motion, row: int, direction: int) -> bytes:
    """Return the modes that follow if one of the held rows lets go alone, as bytes; empty if none are consistent."""
    system, equations, none = held.system, held.equations, np.zeros(held.system.m, dtype=bool)
    now = Situation(held.t, held.y, piece.labels, held.since, none, none)
    search = Search(system, held.segment, now, piece.labels, equations.is_held, equations.regions, None)
    trial = equations.modes.copy()
    trial[row] = direction
    try:
        return search.run(trial)[0].equations.modes.tobytes()
    except Inconsistent:
        return b""


def beyond_event(
    nearby: Nearby, following: Piece, motion: Motion, S: Array, since: Array, times: Array
) -> Iterator[tuple[int, str]]:
    """Find directions in which a row that is held after an event, with its force exactly at its level, would let go."""
    if not np.any(following.modes == 0):
        return
    for k, label in _off_levels(VariedGuards(nearby, following, motion), S, since, times):
        yield k, f"{label} is exactly at its level after an event"


def _off_levels(own: VariedGuards, S: Array, since: Array, times: Array) -> Iterator[tuple[int, str]]:
    """Find directions that move forces off their levels where a motion starts at them, with the labels of the guards.

    `own` are the guards of the motion. The time at which it starts changes by `times`.
    """
    guards, motion = own.guards, own.guards.motion
    is_force = ~(guards.is_velocity | guards.is_border)
    at = ((np.abs(guards.start[0]) <= _TOUCH * guards.scale) & is_force).nonzero()[0]
    for i, k in own.moved(at, 0.0, motion.exact(0.0, motion.y), S, since, times):
        yield k, own.label(i)


def at_rest_together(
    nearby: Nearby, number: int, motion: Motion, S: Array, times: Array, relaxed: set[str]
) -> Iterator[tuple[int, str]]:
    """Find directions in which rows that come to rest together would do so one after the other."""
    system, (piece, following) = nearby.system, nearby.trajectory.pieces[number : number + 2]
    path = piece.kept_path
    tau = float(path.taus[-1])
    before = (np.abs(piece.modes) == 1) & system.hard
    w = system.relative_velocity(path.last, motion.loads(tau))
    rests = (following.modes == 0) | (following.modes == -piece.modes)
    rows = (before & rests & (np.abs(w) <= _AT_REST * nearby.state_sizes[0])).nonzero()[0]
    rows = rows[system.laws.rests_below[rows] == 0]
    if not rows.size:
        return
    still = np.zeros((system.m, nearby.count))
    slopes = nearby.slopes_at(_relative, motion, still, tau, path.last, S)
    rate = motion.rate(tau, path.last)
    slopes = slopes + np.outer(motion.relative_accelerations(tau, path.last), times)
    scale = _speed_slopes(nearby, S, rate, times)
    for k in np.isfinite(times).nonzero()[0].tolist():
        names = [system.rows[j].name for j in rows.tolist() if not abs(slopes[j, k]) <= TIE * scale[k]]
        if off := [name for name in names if name not in relaxed]:
            yield k, f"events fall together: {off[0]!r} comes to rest, too"


def _speed_slopes(nearby: Nearby, S: Array, rate: Array, times: Array) -> Array:
    """Return for each direction the size of the terms that add up in derivatives of velocities."""
    n = nearby.system.n
    found = np.abs(S[:n]).max(axis=0, initial=0.0) + np.abs(rate[:n]).max(initial=0.0) * np.abs(times)
    return np.asarray(found + 1e-4 * nearby.state_sizes[0] / nearby.sizes)


def _moved(slopes: Array, limits: Array) -> Iterator[tuple[int, int]]:
    """Yield directions in which some line changes by more than the limit there, and the first line that does."""
    off = np.abs(slopes) > limits
    for k in np.flatnonzero(off.any(axis=0)).tolist():
        yield k, int(off[:, k].argmax())


def _relative(motion: Motion, taus: Array, y: Array) -> Array:
    return motion.system.relative_velocity(y, motion.loads(taus))
