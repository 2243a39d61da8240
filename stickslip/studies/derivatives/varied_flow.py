"""First variations while the modes hold: ``S' = f_y S + f_p`` by Taylor series, or along the path of a solver."""

from __future__ import annotations

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array
from stickslip.model.crossings import root_between
from stickslip.results.pieces import Piece
from stickslip.studies.derivatives.nearby import Nearby, total
from stickslip.studies.derivatives.radau import STAGES, radau
from stickslip.studies.derivatives.steep import SteepPath, brought_to_rest, least_change

_ORDER = 20
_REMAINDER = 1e-16
_JOINED = 16  # most steps of the solver that one collocation covers
_COLLOCATIONS_AT_ONCE = 8  # for which the forcing of S is computed together
_GROWTH, _LEAST = 4.0, 1e-9  # largest factor by which the number of joined steps may grow, and least roughness

# The last coefficient of a polynomial may be this part of the largest one. The error of S is far smaller: 1e-11 in
# smooth motions, and 1e-10 where a function has a kink in its slope.
_LAST = 1e-6

# A step ends before a turn by this part of itself: its last point has to lie on the same side as the others.
_BEFORE_TURN = 1e-11

_BY_TIME = 1e-4  # step of differences by the time, as a part of the motion

_TINY = np.finfo(float).tiny


def flow(
    nearby: Nearby, piece: Piece, motion: Motion, S: Array, since: Array, begin: Array
) -> tuple[Array, Array, bool]:
    """Return the ends of steps and the coefficients of S along a motion from its variations at the start.

    The time at which it starts changes by `begin`. Also return whether friction falls too steeply from rest.
    """
    if piece.end <= 0:
        return np.zeros(1), np.zeros((0, 1, nearby.system.size, nearby.count)), False
    if motion.is_linear:
        return _series(nearby, piece, motion, S, since)
    return _collocated(nearby, piece, motion, S, since, begin)


def _series(nearby: Nearby, piece: Piece, motion: Motion, S: Array, since: Array) -> tuple[Array, Array, bool]:
    """Follow ``S' = A S + f_p`` by Taylor series."""
    path, end = piece.kept_path, piece.end
    near = [nearby.near(motion, k) for k in range(nearby.count)]
    tau, guess = 0.0, end
    ends, found = [0.0], []
    while tau < end:
        h = min(guess, end - tau)
        y = motion.exact(tau, path.at(np.array([tau]))[0])
        c = _homogeneous(nearby, motion, tau, y, S, h)
        for k in range(nearby.count):
            others = [(weight, other, other.exact(tau, y)) for weight, other in near[k]]
            if motion.rises_push and since[:, k].any():
                aged = nearby.along_ages(motion, since[:, k], y[:, None])
                others += [(weight, other, y) for weight, other, _ in aged]
            c[:, :, k] += total([weight * other.expand(tau, at, _ORDER, h).y for weight, other, at in others])
        limit = _step_limit(c)
        c *= (limit ** np.arange(_ORDER + 1))[:, None, None]
        guess = 1.5 * limit * h
        tau = end if limit == 1.0 and h >= end - tau else tau + limit * h
        S = c.sum(axis=0)
        ends.append(tau)
        found.append(c)
    return np.array(ends), np.array(found), False


def _homogeneous(nearby: Nearby, motion: Motion, tau: float, y: Array, S: Array, h: float) -> Array:
    """Return the coefficients of S without forcing: differences of motions, which are linear in their start."""
    none = np.zeros((nearby.system.drives, nearby.count))
    S = motion.equations.consistent(S.copy(), none)
    c = np.zeros((_ORDER + 1, nearby.system.size, nearby.count))
    for k in range(nearby.count):
        if not S[:, k].any():
            continue
        part = 1.0 / float((np.abs(S[:, k]) / nearby.state_sizes).max())
        ahead = motion.expand(tau, y + part * S[:, k], _ORDER, h).y
        c[:, :, k] = (ahead - motion.expand(tau, y - part * S[:, k], _ORDER, h).y) / (2 * part)
    return c


def _step_limit(c: Array) -> float:
    """Return the part of the step whose remainder is below roundoff."""
    sizes = np.nan_to_num(np.abs(c)).max(axis=1)
    powers, limit = np.arange(sizes.shape[0]), 1.0
    for _ in range(40):
        terms = sizes * (limit**powers)[:, None]
        part = float((terms[-2:].max(axis=0) / np.maximum(terms.max(axis=0), _TINY)).max(initial=0.0))
        if part <= 2 * _REMAINDER:
            break
        limit *= 0.99 * (_REMAINDER / part) ** (1.0 / _ORDER)
    return limit


def _collocated(
    nearby: Nearby, piece: Piece, motion: Motion, S: Array, since: Array, begin: Array
) -> tuple[Array, Array, bool]:
    """Follow ``S' = f_y S + f_p`` along a computed path, by Radau's collocation over several of its steps at once.

    Steps are joined as long as one polynomial represents S over all of them: its last coefficient shows that. Where
    bristles turn over, the slopes of the rates jump: a step ends there.

    Where friction with an infinite slope lets a row go, S begins like the rate ``w'`` times the change of the time at
    which it lets go, and errors of that die away as slowly. So the variations at fixed times since then are followed
    at first, which are smooth: ``D = S + y' begin``, with ``D' = f_y D + f_p + f_t begin``.
    """
    size, count = nearby.system.size, nearby.count
    path = SteepPath(motion, piece.kept_path, float(nearby.state_sizes[0]), nearby.bend)
    nodes = radau()[0]
    turns = _turns(motion, path)
    steps = np.union1d(path.taus, turns)
    begun_until = path.begun_until if begin.any() else 0.0
    if begun_until:
        turns = np.union1d(turns, begun_until)
        S = S + np.outer(motion.rate(0.0, motion.y), begin)
    if path.stopping is not None:
        turns = np.union1d(turns, steps[-2])
    stops = np.append(np.searchsorted(steps, turns), steps.size - 1)
    ends, found = [0.0], []
    first, last, joined = 0, steps.size - 1, _JOINED
    while first < last:
        until = stops[np.searchsorted(stops, first, side="right")]
        edges = np.unique(np.minimum(first + joined * np.arange(_COLLOCATIONS_AT_ONCE + 1), until))
        begins, lengths = steps[edges[:-1]], np.diff(steps[edges])
        taus = (begins[:, None] + lengths[:, None] * nodes).ravel()
        y = path.at(taus)
        forcing = nearby.forcing(motion, since, taus, y)
        has_begun = ends[-1] >= begun_until
        if not has_begun:
            forcing = forcing + _by_time(motion, piece.end, taus, y)[:, :, None] * begin
        forcing = np.moveaxis(forcing.reshape(size, lengths.size, nodes.size, count), 0, 2)
        roughest = 0.0
        for i, end in enumerate(edges[1:].tolist()):
            at = slice(i * nodes.size, (i + 1) * nodes.size)
            if end == last and path.stopping is not None:
                c = _to_rest(nearby, motion, path, path.stopping, since, float(begins[i]), S)
                following = c.sum(axis=0)
            else:
                c, following = _collocation(motion, float(lengths[i]), taus[at], y[:, at], forcing[i], S)
            rough = _roughness(c)
            roughest = max(roughest, rough)
            if rough > 1.0 and end - first > 1:
                break
            first, S = end, following
            ends.append(float(steps[end]))
            if not has_begun:
                places = np.append(begins[i], taus[at])
                c = c - np.einsum("ps,is,k->pik", radau()[2], motion.rate(places, path.at(places)), begin)
                S = c.sum(axis=0) if ends[-1] >= begun_until else S
            found.append(c)
        # the last coefficient grows with the length to the power of its order
        factor = 0.9 * max(roughest, _LEAST) ** (-1.0 / STAGES)
        joined = min(max(int(joined * min(factor, _GROWTH)), 1), _JOINED)
    return np.array(ends), np.array(found), path.is_lost


def _by_time(motion: Motion, end: float, taus: Array, y: Array) -> Array:
    """Return the derivatives of the rates by the time, at fixed states and relative velocities.

    Where drives accelerate, states are moved until the relative velocities of rows whose friction depends on them are
    the same, and the effect of this shift is subtracted, as in `Nearby.forcing`.
    """
    h, rows, system = _BY_TIME * end, motion.equations.velocity_dependent, motion.system
    w, found = system.relative_velocity(y, motion.loads(taus))[rows], np.zeros(y.shape)
    shift = np.zeros(y.shape)
    for k, weight in enumerate((-1.5, 2.0, -0.5)):
        later = taus + k * h
        change = least_change(motion.equations, rows, w - system.relative_velocity(y, motion.loads(later))[rows])
        found += weight / h * motion.rate(later, y + change)
        shift += weight / h * change
    for i, matrix in enumerate(motion.true_jacobians(taus, y)):
        found[:, i] -= matrix @ shift[:, i]
    return found


def _turns(motion: Motion, path: SteepPath) -> Array:
    """Return the times just before those at which relative velocities of rows with bristles pass 0, in order."""
    equations, system = motion.equations, motion.system
    rows = equations.velocity_dependent[equations.law.bristles]
    if not rows.size:
        return np.empty(0)

    def velocities(taus: Array) -> Array:
        return np.asarray(system.relative_velocity(path.at(taus), motion.loads(taus))[rows])

    taus = np.union1d(path.taus, path.taus[:-1] + 0.5 * np.diff(path.taus))
    w = velocities(taus)
    found = []
    for j, i in np.argwhere(w[:, :-1] * w[:, 1:] < 0).tolist():

        def velocity(tau: float, j: int = j) -> float:
            return float(velocities(np.array([tau]))[j, 0])

        begin, end = taus[i : i + 2].tolist()
        # a velocity that is 0 but for roundoff may have another sign when it is computed for one time alone
        turn = begin if abs(w[j, i]) < abs(w[j, i + 1]) else end
        if velocity(begin) * velocity(end) < 0:
            turn = root_between(velocity, begin, end)
        found.append(max(begin, turn - _BEFORE_TURN * (end - begin)))
    return np.unique(found)


def _collocation(motion: Motion, h: float, taus: Array, y: Array, forcing: Array, S: Array) -> tuple[Array, Array]:
    """Return the coefficients of S in a step of length `h`, from S at its start, and S at its end.

    `y` are the states, and `forcing` the rates that S does not cause, at the times of the stages.
    """
    _, weights, to_powers = radau()
    slopes = np.array([dense(matrix) for matrix in motion.true_jacobians(taus, y)])
    blocks = h * weights[:, None, :, None] * slopes.transpose(1, 0, 2)[None]
    whole = np.eye(y.size) - blocks.reshape(y.size, y.size)
    right = S[None] + h * np.einsum("ij,jsk->isk", weights, forcing)
    # NaN in one direction must not spread to the others
    stage = np.linalg.solve(whole, np.nan_to_num(right).reshape(y.size, -1))
    stage = stage.reshape(right.shape) + 0 * right
    return np.einsum("pj,jsk->psk", to_powers, np.concatenate([S[None], stage])), stage[-1]


def _to_rest(
    nearby: Nearby, motion: Motion, path: SteepPath, stopping: int, since: Array, tau: float, S: Array
) -> Array:
    """Return the coefficients of S in the last step, from `tau` on, in which a row comes to rest.

    Its friction has a slope without bound at rest, and the step is so short that nothing else changes. Then a change of
    its relative velocity w does what a shift in time does: ``S_end = S + (y'_end - y') dw / w'``, where dw is the
    derivative of w at `tau`.
    """
    row = np.array([stopping])

    def velocity(own: Motion, taus: Array, states: Array) -> Array:
        return np.asarray(own.system.relative_velocity(states, own.loads(taus))[row])

    y = path.at(np.array([tau]))[:, 0]
    end = float(path.taus[-1])
    last = brought_to_rest(motion, row, end, path.at(path.taus[-1:])[:, 0])
    change = motion.rate(end, last) - motion.rate(tau, y)
    of_w = nearby.slopes_at(velocity, motion, since, tau, y, S, is_linear=True)[0]
    c = np.zeros((STAGES + 1, *S.shape))
    c[0], c[1] = S, np.outer(change / motion.relative_accelerations(tau, y)[row], of_w)
    return c


def _roughness(c: Array) -> float:
    """Return the last coefficient of a polynomial of S as a multiple of what is allowed: above 1 it is too rough."""
    sizes = np.nan_to_num(np.abs(c))
    return float((sizes[-1] / (_LAST * np.maximum(sizes.max(axis=0), _TINY))).max(initial=0.0))
