"""What has to close after a period of a limit cycle, its coordinates, and scenes that start anywhere on it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.model.elements import Block
from stickslip.model.scene import Scene
from stickslip.results.continuation import in_state, on_stops
from stickslip.simulation.result import Result
from stickslip.studies.derivatives.directions import Direction

# Combinations of positions that do not move count as moving by this part of the positions, and have to close to 1e-10
# of that.
_STILL = 1e-6

_APART = 1e-9  # breaks nearer to each other than this part of a period may be one break but for roundoff


def check_loads(system: System, period: float) -> None:
    """Refuse loads that do not repeat with the period."""
    loads = system.loads(0.0, 2 * period)
    # loads are compared between any two breaks, too, wherever in the period these are
    edges = np.unique([0.0, period, *np.fmod(loads.breaks, period)])
    lengths = np.diff(edges)
    inner = (edges[:-1] + 0.37 * lengths)[lengths > _APART * period]
    places = np.sort(np.append((np.arange(97) + 0.37) / 97 * period, inner))
    now, later = (np.array([loads.after(t).at(t) for t in (places + start).tolist()]) for start in (0.0, period))
    size = np.maximum(np.abs(now), np.abs(later)).max(axis=0, initial=0.0)
    for k, i in np.argwhere(np.abs(now - later) > 1e-9 * size)[:1].tolist():
        raise ValueError(
            f"limit_cycle: the loads do not repeat with the period {period:g} s: one is {now[k, i]:.9g} at "
            f"t = {places[k]:.6g} s and {later[k, i]:.9g} at t = {places[k] + period:.6g} s; give a period of all "
            "loads (to continue_cycle as a function of the value, where it changes with that), and to functions of the "
            "state a load that repeats, such as a sine, in place of TIME"
        )
    _check_blocks(system, places.tolist(), period)


def _check_blocks(system: System, times: Sequence[float], later: float | None) -> None:
    """Refuse blocks that read the time, unless they repeat.

    Their functions must return the same a time `later`, or at all times if that is None.
    """
    if not any(isinstance(place.block, Block) for place in system.blocks.values()):
        return
    y = system.at_start()
    q = system.loads(0.0, later or 1.0).after(0.0).at(0.0)
    if system.dependence is not None:
        system.dependence.fill(q, y, 0.0, 0.0, None)
    for place in system.blocks.values():
        block = place.block
        if not isinstance(block, Block):
            continue
        x, u = y[place.first : place.first_held], system.inputs_of(place, y, q)
        calls = [("derivative", place.states)] if block.states else []
        if block.output is not None:
            calls.append(("output", place.outputs))
        for what, count in calls:
            for t in times:
                pair = (t, t + later) if later is not None else (0.0, t)
                now, then = (block.call(what, at, x, u, count, exactly=False) for at in pair)
                if not np.allclose(now, then, rtol=1e-9, atol=1e-9 * float(np.abs(then).max(initial=0.0))):
                    said = f"repeat with the period {later:g} s" if later is not None else "stay the same"
                    raise ValueError(
                        f"limit_cycle: {block.label}: its {what} does not {said}: it reads the time, and is "
                        f"{now} at t = {pair[0]:.6g} s and {then} at t = {pair[1]:.6g} s; give the period of all that "
                        "changes with time, period=..."
                    )


def check_constant(system: System) -> None:
    """Refuse loads that change: then the period is that of the loads."""
    # sines and functions have a period; all others are straight lines with a last break, and are read for all times
    is_straight = math.isinf(system.loads(0.0, 1.0).period)
    loads = system.loads(0.0, math.inf if is_straight else 1.0)
    segments = [loads.after(t) for t in (0.0, *loads.breaks)]
    if not is_straight or any(not one.is_steady or np.any(one.value != segments[0].value) for one in segments):
        raise ValueError(
            "limit_cycle: the loads change with time; give their period, period=... (it is found only where loads are "
            "constant; of loads that become constant give the last values; where the period changes with the value, "
            "give continue_cycle a function of it)"
        )
    _check_blocks(system, [(k + 0.37) * math.pi for k in range(7)], None)


def read_positions(system: System) -> Array:
    """Return orthonormal combinations of positions that forces, blocks, stops or gaps read, a line each."""
    places = slice(system.n, system.first_bristle)
    lines = [dense(system.C)[:, places], dense(system.block_C)[:, places]]
    if system.piecewise.count:
        lines += [dense(one)[:, places] for one in (system.piecewise.value_y, system.piecewise.border_y)]
    if system.dependence is not None:
        every = np.eye(system.first_bristle - system.n)
        read = np.intersect1d(system.dependence.states, np.arange(system.n, system.first_bristle))
        lines.append(every[read - system.n])
    block = np.concatenate(lines)
    if not block.size:
        return np.zeros((0, system.first_bristle - system.n))
    _, sizes, found = np.linalg.svd(block)
    rank = int(np.count_nonzero(sizes > 1e-12 * sizes.max(initial=0.0)))
    return np.asarray(found[:rank])


class Closing:
    """What has to close after a period: velocities, positions that are read, and all other states."""

    def __init__(self, system: System) -> None:
        self._n, self._first, self._read = system.n, system.first_bristle, read_positions(system)
        # all velocities are measured by one size, and so are all positions
        self.groups = slice(self._n), slice(self._n, self._n + self._read.shape[0])

    def of(self, y: Array) -> Array:
        """Return the part of a state that has to close, or of states in columns."""
        n, first = self._n, self._first
        return np.concatenate([y[:n], self._read @ y[n:first], y[first:]])


def movable(system: System, read: Array, closed: Mask) -> Array:
    """Return the possible changes of positions, a line each, that change the combinations `read`.

    Drives cannot be moved, and ties and `closed` rows still have to hold.
    """
    rows = (system.is_tie | closed).nonzero()[0]
    lines = np.hstack([dense(system.G[rows]), dense(system.D[rows])])
    # positions that are no states may be anything: rows are combined so that these drop out
    others = np.setdiff1d(np.arange(lines.shape[1]), system.placed)
    bodies = others[others < system.n]
    if rows.size and bodies.size:
        lines = scipy.linalg.null_space(lines[:, bodies].T).T @ lines
    fixed = np.concatenate([lines[:, system.placed], np.eye(system.placed.size)[system.placed >= system.n]])
    if not fixed.size:
        return read
    basis = scipy.linalg.orth(fixed.T)
    _, sizes, found = np.linalg.svd(read - read @ basis @ basis.T)
    return np.asarray(found[: np.count_nonzero(sizes > 1e-9)])


class Coordinates:
    """Coordinates of the states near the start of a motion: velocities, positions read, bristles and blocks, ages.

    Velocities that follow from others in the first motion, because rows are held, are left out. Rows with a dwell time
    that show the mode STUCK in it have ages; such a row may be held by others, or by nothing.
    """

    def __init__(self, system: System, motion: Motion, shown: Modes) -> None:
        self.system = system
        n, size = system.n, system.size
        self.free = np.setdiff1d(np.arange(n), motion.equations.dependent)
        held = motion.equations.is_held
        self.aged = system.aging[shown[system.aging] == 0]
        read = read_positions(system)
        changes = movable(system, read, held & system.is_stop)
        # from positions to how far each of these changes has gone
        self._read = changes if changes is read else np.linalg.pinv(read @ changes.T) @ read
        more = size - system.first_bristle
        count = self.free.size + changes.shape[0] + more
        # from coordinates to states: velocities of held rows follow, and positions that no force reads stay
        self.to_states = np.zeros((size, count))
        self.to_states[self.free, np.arange(self.free.size)] = 1.0
        none = np.zeros((system.drives, count))
        self.to_states = motion.equations.consistent(self.to_states, none)
        self.to_states[n : system.first_bristle, self.free.size : count - more] = changes.T
        self.to_states[system.first_bristle :, count - more :] = np.eye(more)
        self.size = count + self.aged.size

    def of(self, y: Array) -> Array:
        """Return the coordinates of a state, or of columns of them; ages are not among them."""
        n, first = self.system.n, self.system.first_bristle
        return np.concatenate([y[self.free], self._read @ y[n:first], y[first:]])

    def directions(self) -> list[Direction]:
        """Return the directions in which each coordinate grows."""
        none = np.zeros(self.system.m)
        found = [Direction(f"state {k}", (), column, none) for k, column in enumerate(self.to_states.T)]
        for row in self.aged.tolist():
            since = none.copy()
            since[row] = -1.0
            found.append(Direction(f"age {row}", (), np.zeros(self.system.size), since))
        return found

    def sizes(self, result: Result) -> Array:
        """Return the size of each coordinate over a motion: its range, one for all velocities and one for positions."""
        states = self.of(result.y)
        half = self.free.size
        found = np.ones(self.size)
        # of all bodies, free at the start or not: beside a body that slips, the velocity of one at rest is roundoff
        speeds = result.y[: self.system.n]
        found[:half] = max(float(np.ptp(speeds)) if speeds.size else 0.0, 1e-300)
        # one size for all positions; each bristle and each state of a block has its own
        first = half + self._read.shape[0]
        last = states.shape[0]
        found[half:first] = position_size(self.system, result, states[half:first])
        found[first:last] = np.maximum(np.ptp(states[first:], axis=1), 1e-300)
        found[last:] = result.t[-1] - result.t[0]
        return found


def position_size(system: System, result: Result, read: Array) -> float:
    """Return the size of combinations of positions over a motion: their range, unless it is roundoff."""
    whole = np.abs(result.y[system.n : system.first_bristle]).max(initial=0.0)
    return float(max(np.ptp(read, axis=1).max(initial=0.0), _STILL * whole, 1e-300))


def started(scene: Scene, system: System, y: Array, aged: Indices, ages: Array, modes: Modes) -> Scene:
    """Return a scene that starts at t = 0 from a state, with rows that have rested for some time.

    `aged` are the rows with a dwell time that rest, and `ages` for how long in s. Contacts with a pre-slip velocity
    that slip in `modes` begin in their slip state.
    """
    y = on_stops(system, y, modes, np.zeros(system.n + system.drives))
    rested = np.zeros(system.m)
    rested[aged] = ages
    moving = [one.name for one in (*scene.bodies, *scene.drives)]
    return in_state(
        scene,
        system,
        y,
        velocities=dict(zip(moving, y[: system.n].tolist(), strict=False)),
        positions={moving[i]: float(y[state]) for i, state in system.position_state.items()},
        rested=rested,
        slipping=(np.abs(modes) == 1) & ~system.hard,
        sampled={},
    )


def scene_at(result: Result, t: float) -> Scene:
    """Return the scene as it is at a time of its motion, the right limit at an event."""
    trajectory = result.trajectory
    system: System = trajectory.system
    piece = trajectory.pieces[int(trajectory.places(np.array([t]))[0])]
    held = system.aging[piece.labels[system.aging] == 0]
    return started(result.scene, system, result(t), held, t - piece.since[held], piece.modes)


def middle_of(result: Result, begin: float, end: float) -> float:
    """Return the middle of the longest motion between two times, in s."""
    pieces = result.trajectory.pieces

    def length(number: int) -> float:
        piece = pieces[number]
        return min(piece.stop, end) - max(piece.t, begin)

    piece = pieces[max(range(len(pieces)), key=length)]
    return 0.5 * (min(piece.stop, end) + max(piece.t, begin))
