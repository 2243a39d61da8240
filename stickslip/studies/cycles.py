"""Limit cycles: periodic motions, found by shooting with exact derivatives, and whether they are stable.

The state ``z`` that closes after one period holds velocities, bristles, and of positions only what forces read: bodies
may drift as long as nothing feels it. With the monodromy matrix ``M = dz(T)/dz(0)`` Newton's method solves

    z(T) = z(0)                              with a period given, and otherwise also   f . (z(0) - z_guess) = 0

where ``f = z'`` and T is unknown, too. Multipliers are the eigenvalues of M, without the 1 that belongs to the
direction of the motion where the period is free.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.model.elements import Block, Body, Contact, Drive, StateSpace
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results.outcome import Event
from stickslip.simulation.result import Result, SimulationError
from stickslip.simulation.simulate import compiled
from stickslip.studies.directions import Direction, along_parameter, along_start
from stickslip.studies.parameters import Parameter, named_parameters
from stickslip.studies.variations import Variation, simulated

__all__ = ["Cycle", "CycleError", "limit_cycle"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.intp]

_MOST_STEPS, _MOST_HALVINGS, _PATIENCE = 25, 6, 4
_CLOSED = 1e-10
"""A motion closes where it misses its start by no more than this part of its size; one by CVODE a thousand times as
much."""

_SURE = 1e-4
"""Part of what is enough at which no further step is taken."""

_NEAR = 0.05
"""Part of its size within which a motion comes back to where a search begins."""

_NEAR_BY, _FAR = 0.05, 0.5
"""A cycle that lies further from what was foretold than this part of its size, and than this part of what was to
change, is another one."""

_INWARDS = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Parts by which a cycle is made smaller to find one just within it."""

_TURNS, _LONGER, _TRIES = 12, 4.0, 5
_ZERO = 1e-9
_NEUTRAL = 1e-6
_LOOKS = 16


class CycleError(RuntimeError):
    """No limit cycle was found; the message says why."""


@dataclass(frozen=True)
class Cycle:
    """A periodic motion.

    Attributes
    ----------
    period : float
        In s.
    multipliers : array of complex
        Of the map over one period, largest first: by what factors small deviations grow. Where the period is free, the
        multiplier 1 of a shift along the motion is left out. A phase in which a contact sticks makes one 0.
    scene : Scene
        The scene, starting on the cycle at t = 0.
    result : Result
        One period of it.
    sequence : tuple of str
        The changes of modes in one period, in order.
    forced : bool
        Whether the loads set the period.
    closes : float
        By what part of its size the motion misses its start after one period.
    shot : Shot
        How it was computed: the map over one period and its derivatives.
    """

    period: float
    multipliers: Complex
    scene: Scene = field(repr=False)
    result: Result = field(repr=False)
    sequence: tuple[str, ...]
    forced: bool
    closes: float
    shot: Shot = field(repr=False, compare=False)

    @property
    def stable(self) -> bool:
        """Whether small deviations die away: all multipliers are smaller than 1, by more than errors."""
        return bool(np.all(np.abs(self.multipliers) < 1.0 - _NEUTRAL))

    @property
    def neutral(self) -> bool:
        """Whether small deviations neither grow nor die away: the largest multiplier is 1, as in a family of cycles."""
        largest = float(np.abs(self.multipliers).max(initial=0.0))
        return abs(largest - 1.0) <= _NEUTRAL

    @property
    def sticks(self) -> bool:
        """Whether a contact sticks for a while, so that a multiplier is 0."""
        return any((piece.labels == 0).any() for piece in self.result.trajectory.pieces)

    def amplitude(self, body: str) -> float:
        """Return half of the range of a body's position over the cycle, in m or rad.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        found = self.result.fit_for_plot(4000)
        t, v = found.t, found.velocity(body)
        turns = [
            t[i] + (t[i + 1] - t[i]) * v[i] / (v[i] - v[i + 1])
            for i in np.flatnonzero((v[:-1] * v[1:] < 0) & (np.diff(t) > 0)).tolist()
        ]
        at = np.sort(np.concatenate([t, turns]))
        x = self.result.sample(at).position(body)
        return 0.5 * float(x.max() - x.min())

    def sensitivities(self, parameters: Iterable[str]) -> Array:
        """Return the derivatives of the period with respect to parameters of the scene, (parameters,).

        The period of a forced cycle is given: its derivatives are 0.

        Raises
        ------
        ValueError, TypeError
            If a name leads to no number of the scene.
        CycleError
            If the cycle is the edge of others (a multiplier is 1), or a derivative does not exist.
        """
        named = named_parameters(self.scene, parameters, "Cycle.sensitivities")
        return np.array([self.shot.along(one)[1] for one in named])

    def _repr_html_(self) -> str:
        """Return one period as a figure, and the multipliers, as notebooks show them."""
        from stickslip.plots.notebook import cycle_html

        return cycle_html(self)

    def __str__(self) -> str:
        """Return what there is to say of the cycle."""
        kind = "stable" if self.stable else "neutral" if self.neutral else "unstable"
        lines = [f"period {self.period:.12g} s{' (given)' if self.forced else ''}, {kind}"]
        for one in self.multipliers:
            said = f"{one.real:.9g}" if abs(one.imag) <= _ZERO else f"{one.real:.9g} {one.imag:+.9g}i"
            lines.append(f"multiplier {said}, modulus {abs(one):.9g}")
        if self.sticks and np.any(self.multipliers == 0):
            lines.append(
                "a contact sticks: in one direction the motion forgets what was before (multiplier 0)"
            )
        return "\n".join([*lines, *self.sequence])


def limit_cycle(
    scene: Scene,
    *,
    period: float | None = None,
    guess: float | None = None,
    transient: float | None = None,
    method: str = "auto",
    rtol: float = 1e-11,
    atol: float = 1e-13,
) -> Cycle:
    """Return a periodic motion of a scene, and its multipliers.

    A transient leads near the cycle, where it is stable; Newton's method with exact derivatives through events finds
    it to roundoff. Unstable cycles are found from a start near them with ``transient=0``.

    Parameters
    ----------
    scene : Scene
    period : float, optional
        Period in s of the loads, or a multiple of it; without it the loads must be constant, and the period is found.
    guess : float, optional
        About the period in s, where it is to be found; by default it is seen in the transient.
    transient : float, optional
        How long in s the scene moves before the search. By default as long as it takes to come back to where it was;
        50 periods where the period is given. With 0 the search begins at the scene's own start.
    method, rtol, atol
        As `simulate` takes them.

    Raises
    ------
    ValueError, TypeError
        If an argument is not usable, or loads and period do not go together.
    CycleError
        If no cycle was found; the message says why.
    SimulationError
        If the simulation cannot go on.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"limit_cycle: scene must be a Scene, got {type(scene).__name__}")
    for name, value in (("period", period), ("guess", guess)):
        if value is not None and not (isinstance(value, (int, float)) and 0 < value < math.inf):
            raise ValueError(f"limit_cycle: {name} must be a positive time in s, got {value!r}")
    if transient is not None and not (isinstance(transient, (int, float)) and 0 <= transient < math.inf):
        raise ValueError(f"limit_cycle: transient must be a time in s, at least 0, got {transient!r}")
    options = {"method": method, "rtol": rtol, "atol": atol}
    system = compiled(scene)
    if system.bristle_state:
        raise ValueError(
            "limit_cycle: cycles of laws with bristles are not searched for; take the DryFriction at their core"
        )
    if system.sampled:
        raise ValueError(
            "limit_cycle: sampled blocks have no derivatives here; blocks in continuous time have"
        )
    if period is not None:
        if guess is not None:
            raise ValueError("limit_cycle: give the period or a guess of it, not both")
        _check_loads(system, period)
        start = scene
        if transient != 0:
            periods = 50 if transient is None else max(1, math.ceil(transient / period - 1e-9))
            start = _settled(scene, period, periods, options)
        return _closed(Shot(start, period, True, options))
    _check_constant(system)
    if transient == 0:
        if guess is None:
            raise ValueError("limit_cycle: without a transient give a guess of the period, guess=...")
        return _once(_closed(Shot(scene, float(guess), False, options)))
    start, about = _returning(scene, guess, transient, options)
    return _once(_closed(Shot(start, about, False, options)))


def _once(cycle: Cycle) -> Cycle:
    """Return a cycle of free period as one turn, where it was found as several."""
    count = len(cycle.sequence)
    for turns in range(count, 1, -1):
        if count % turns:
            continue
        shot = Shot(cycle.scene, cycle.period / turns, False, cycle.shot.options)
        if shot.error <= 1e3 * shot.enough:
            return _closed(shot)
    return cycle


# -- the loads ---------------------------------------------------------------------------------------------------


def _check_loads(system: System, period: float) -> None:
    """Refuse loads that do not repeat with the period."""
    loads = system.loads(0.0, 2 * period)
    places = (np.arange(97) + 0.37) / 97 * period
    for t in places.tolist():
        now, later = loads.after(t).at(t), loads.after(t + period).at(t + period)
        off = np.abs(now - later) > 1e-9 * (np.abs(now) + np.abs(later)) + 1e-12
        if off.any():
            raise ValueError(
                f"limit_cycle: the loads do not repeat with the period {period:g} s: one is {now[off][0]:.9g} at "
                f"t = {t:.6g} s and {later[off][0]:.9g} at t = {t + period:.6g} s; give a period of all loads"
            )


def _check_constant(system: System) -> None:
    """Refuse loads that change: then the period is that of the loads."""
    loads = system.loads(0.0, 1.0)
    if (
        loads.breaks
        or not math.isinf(loads.period)
        or any(np.any(loads.after(t).at(t) != loads.after(0.0).at(0.0)) for t in (0.0, 0.31, 0.77))
    ):
        raise ValueError(
            "limit_cycle: the loads change with time; give their period, period=... "
            "(it is found only where loads are constant)"
        )


# -- what closes -------------------------------------------------------------------------------------------------


def _read_positions(system: System) -> Array:
    """Return orthonormal combinations of positions that forces, blocks, stops or gaps read, a line each."""
    places = slice(system.n, system.first_bristle)
    lines = [_dense(system.C)[:, places], _dense(system.block_C)[:, places]]
    if system.piecewise.count:
        lines += [_dense(one)[:, places] for one in (system.piecewise.value_y, system.piecewise.border_y)]
    if system.dependence is not None:
        every = np.eye(system.first_bristle - system.n)
        read = np.intersect1d(system.dependence.columns, np.arange(system.n, system.first_bristle))
        lines.append(every[read - system.n])
    block = np.concatenate(lines)
    if not block.size:
        return np.zeros((0, system.first_bristle - system.n))
    _, sizes, found = np.linalg.svd(block)
    rank = int(np.count_nonzero(sizes > 1e-12 * sizes.max(initial=0.0)))
    return np.asarray(found[:rank])


def _seen(system: System, y: Array, read: Array) -> Array:
    """Return what has to close of states (or columns of them): velocities, positions that are read, all others."""
    n, first = system.n, system.first_bristle
    return np.concatenate([y[:n], read @ y[n:first], y[first:]])


def _movable(system: System, held: NDArray[np.bool_], read: Array) -> Array:
    """Return the combinations of positions that closed stops leave free, of those that are read."""
    closed = (held & system.is_stop).nonzero()[0]
    if not closed.size:
        return read
    lines = np.hstack([_dense(system.G[closed]), _dense(system.D[closed])])[:, system.placed]
    fixed = scipy.linalg.orth(lines.T)
    _, sizes, found = np.linalg.svd(read - read @ fixed @ fixed.T)
    return np.asarray(found[: np.count_nonzero(sizes > 1e-9)])


class _Coordinates:
    """Coordinates of the states near the start of a motion: velocities, positions read, bristles and blocks, ages.

    Parameters
    ----------
    system : System
    motion : Motion
        The first motion: held velocities follow from others.
    """

    def __init__(self, system: System, motion: Motion) -> None:
        self.system, self.motion = system, motion
        n, size = system.n, system.size
        free = np.ones(n, dtype=bool)
        free[motion.equations.dependent] = False
        self.free = free.nonzero()[0]
        self._read = _read_positions(system)
        held = motion.equations.is_held
        self.aged = system.dwelling[held[system.dwelling]]
        self._read = _movable(system, held, self._read)
        more = size - system.first_bristle
        count = self.free.size + self._read.shape[0] + more
        # from coordinates to states: held velocities follow, what forces do not read stays
        self.to_states = np.zeros((size, count))
        self.to_states[self.free, np.arange(self.free.size)] = 1.0
        none = np.zeros((system.drives, count))
        self.to_states = motion.equations.consistent(self.to_states, none)
        self.to_states[n : system.first_bristle, self.free.size : count - more] = self._read.T
        self.to_states[system.first_bristle :, count - more :] = np.eye(more)
        self.size = count + self.aged.size

    def of(self, y: Array) -> Array:
        """Return the coordinates of a state, or of columns of them; ages are not among them."""
        n = self.system.n
        first = self.system.first_bristle
        return np.concatenate([y[self.free], self._read @ y[n:first], y[first:]])

    def directions(self) -> list[Direction]:
        """Return the directions in which each coordinate grows."""
        none = np.zeros(self.system.m)
        found = [along_start(f"state {k}", column, none) for k, column in enumerate(self.to_states.T)]
        for row in self.aged.tolist():
            since = none.copy()
            since[row] = -1.0
            found.append(along_start(f"age {row}", np.zeros(self.system.size), since))
        return found

    def sizes(self, result: Result) -> Array:
        """Return the size of each coordinate over a motion, velocities and positions apart, at least their changes."""
        states = self.of(result.y)
        half = self.free.size
        found = np.ones(self.size)
        # a motion that hardly changes its velocities is as large as the velocities of its drives
        speeds = states[:half]
        found[:half] = max(float(np.ptp(speeds)) if speeds.size else 0.0, 1e-300)
        # positions are as large as the largest of them, bristles and states of blocks each as itself
        first = half + self._read.shape[0]
        last = states.shape[0]
        found[half:first] = max(float(np.ptp(states[half:first], axis=1).max(initial=0.0)), 1e-300)
        found[first:last] = np.maximum(np.ptp(states[first:], axis=1), 1e-300)
        found[last:] = result.t[-1] - result.t[0]
        return found


class Shot:
    """One period of a motion from a scene's start, and by how much it misses its start.

    Parameters
    ----------
    scene : Scene
        Starts at t = 0.
    period : float
        In s.
    forced : bool
        Whether the period is given.
    options : dict
        Of `simulate`.
    """

    def __init__(self, scene: Scene, period: float, forced: bool, options: dict[str, Any]) -> None:
        self.scene, self.period, self.forced, self.options = scene, period, forced, options
        self._by_parameter: dict[str, tuple[Array, Array]] = {}
        self.result = simulated(scene, (0.0, period), **options)
        trajectory = self.result.trajectory
        self.system: System = trajectory.system
        first = trajectory.pieces[0]
        self.coordinates = _Coordinates(self.system, trajectory.motion(0))
        last = trajectory.pieces[-1]
        assert last.path is not None
        self.start, self.stop = first.y, last.path.last
        aged = self.coordinates.aged
        self.ages = -first.since[aged]
        self.ages_after = period - last.since[aged]
        before, after = self.coordinates.of(self.start), self.coordinates.of(self.stop)
        self.missed = np.concatenate([after - before, self.ages_after - self.ages])
        self.sizes = self.coordinates.sizes(self.result)
        self.error = max(float(np.abs(self.missed / self.sizes).max(initial=0.0)), self._elsewhere)

    @property
    def enough(self) -> float:
        """Below which error it counts as closed."""
        return _CLOSED if self.result.stats["engine"] == "Taylor series" else 1e3 * _CLOSED

    @property
    def _elsewhere(self) -> float:
        """By what part of its size the motion misses its start in what is held at the start and may move at the end."""
        system, read = self.system, _read_positions(self.system)
        n, places = system.n, system.n + read.shape[0]
        off = np.abs(_seen(system, self.stop, read) - _seen(system, self.start, read))[:places]
        size = np.ptp(_seen(system, self.result.y, read), axis=1)[:places]
        parts = [off[:n].max(initial=0.0) / max(size[:n].max(initial=0.0), 1e-300)]
        parts.append(off[n:].max(initial=0.0) / max(size[n:].max(initial=0.0), 1e-300))
        return float(max(parts))

    @cached_property
    def _variation(self) -> Variation:
        return Variation(self.result, self.coordinates.directions())

    def _after(self, variation: Variation) -> Array:
        """Return how the coordinates at the end change in each direction."""
        aged = self.coordinates.aged
        last = self.result.trajectory.pieces[-1]
        end = variation.pieces[-1].at(np.array([last.end]))[:, 0]
        found = np.concatenate([self.coordinates.of(end), -variation.pieces[-1].since[aged]])
        if np.isnan(found).any():
            t, _, why = variation.reasons[0] if variation.reasons else (0.0, 0, "unknown")
            raise CycleError(f"the map over one period has no derivative: at t = {t:.9g} s {why}")
        return found

    @cached_property
    def monodromy(self) -> Array:
        """How coordinates after one period follow those before."""
        return self._after(self._variation)

    def _rate(self, number: int) -> Array:
        """Return the rates of the coordinates at the start or at the end."""
        piece = self.result.trajectory.pieces[number]
        motion = self.result.trajectory.motion(number)
        assert piece.path is not None
        tau = 0.0 if number == 0 else piece.end
        y = piece.y if number == 0 else piece.path.last
        return np.concatenate([self.coordinates.of(motion.rate(tau, y)), np.ones(self.coordinates.aged.size)])

    @cached_property
    def rate_before(self) -> Array:
        """Rates of the coordinates at the start."""
        return self._rate(0)

    @cached_property
    def rate_after(self) -> Array:
        """Rates of the coordinates at the end."""
        return self._rate(len(self.result.trajectory.pieces) - 1)

    def solve(self, right: Array) -> tuple[Array, float]:
        """Return changes of start and period that change by how much the motion misses by `right`.

        Raises
        ------
        CycleError
            If there are none: a cycle next to it is one, too.
        """
        sizes, count = self.sizes, self.coordinates.size
        matrix = (self.monodromy - np.eye(count)) * sizes / sizes[:, None]
        free = not self.forced
        if free:
            matrix = np.block(
                [
                    [matrix, (self.rate_after / sizes * self.period)[:, None]],
                    [(self.rate_before / sizes * self.period)[None, :], np.zeros((1, 1))],
                ]
            )
        sought = np.append(right / sizes, 0.0) if free else right / sizes
        if not count:
            return np.zeros(0), 0.0
        found, *_ = np.linalg.lstsq(matrix, sought, rcond=1e-13)
        if not np.allclose(
            matrix @ found, sought, rtol=1e-6, atol=1e-9 * (1 + np.abs(sought).max(initial=0.0))
        ):
            raise CycleError(
                "a multiplier is 1: cycles are no longer single there (a fold, or a family of them)"
            )
        return found[:count] * sizes, float(found[count] * self.period) if free else 0.0

    def moved(self, change: Array, longer: float, own: Scene | None = None, y: Array | None = None) -> Shot:
        """Return the shot from another start, with another period."""
        if abs(longer) > 0.6 * self.period:
            raise CycleError("the period changes too much for one step")
        states = self.coordinates.to_states
        count = states.shape[1]
        y = (self.start if y is None else y) + states @ change[:count]
        ages = np.maximum(self.ages + change[count:], 0.0)
        modes = self.result.trajectory.pieces[0].modes
        own = self.scene if own is None else own
        try:
            scene = started(own, self.system, y, self.coordinates.aged, ages, modes)
            return Shot(scene, self.period + longer, self.forced, self.options)
        except ValueError as error:
            raise CycleError(f"the search leads to where the scene cannot be: {error}") from None

    def by_parameter(self, parameter: Parameter) -> tuple[Array, Array]:
        """Return how what is missed, and the starting state, change with a parameter."""
        if parameter.name not in self._by_parameter:
            direction = along_parameter(self.scene, parameter, self.result.trajectory, "limit_cycle")
            variation = Variation(self.result, [direction])
            begin = variation.pieces[0].at(np.zeros(1))[:, 0]
            aged = self.coordinates.aged
            before = np.concatenate([self.coordinates.of(begin), -variation.pieces[0].since[aged]])
            found = (self._after(variation) - before)[:, 0], begin[:, 0]
            self._by_parameter[parameter.name] = found
        return self._by_parameter[parameter.name]

    def along(self, parameter: Parameter, given: float = 0.0) -> tuple[Array, float, Array]:
        """Return how start, period and starting state change with a parameter along the cycles.

        A period of the loads that is given changes with it, too, by `given`.
        """
        by_parameter, begin = self.by_parameter(parameter)
        change, longer = self.solve(-by_parameter - self.rate_after * given)
        return change, longer, begin

    def multipliers(self) -> Complex:
        """Return the eigenvalues of the map over one period, along the motion left out where the period is free."""
        matrix = self.monodromy * self.sizes / self.sizes[:, None]
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
        # where held rows leave fewer coordinates, what they forget has the multiplier 0
        ties = (
            np.linalg.matrix_rank(_dense(self.system.G)[self.system.is_tie])
            if self.system.is_tie.any()
            else 0
        )
        read = _read_positions(self.system).shape[0] + self.system.size - self.system.first_bristle
        count = self.system.n - int(ties) + read - (not self.forced)
        return np.concatenate([found, np.zeros(max(count - found.size, 0), dtype=complex)])[:count]


def _dense(matrix: Array) -> Array:
    return matrix.toarray() if hasattr(matrix, "toarray") else matrix


def started(
    scene: Scene, system: System, y: Array, aged: Indices, ages: Array, modes: NDArray[np.int8]
) -> Scene:
    """Return a scene that starts at t = 0 from a state, with rows that have rested for some time.

    Parameters
    ----------
    scene : Scene
    system : System
        Of the scene.
    y : array (size,)
    aged : array of int
        Rows with a dwell time that rest.
    ages : array
        For how long in s.
    modes : array (m,)
        Modes as the equations know them: contacts with a pre-slip velocity remember that they slip.
    """
    rested = dict(zip([system.rows[j].name for j in aged], ages.tolist(), strict=True))
    rows = {row.name: j for j, row in enumerate(system.rows)}
    ends: dict[str, int] = {body.name: k for k, body in enumerate((*scene.bodies, *scene.drives))}
    elements: list[Any] = []
    for element in scene.elements:
        changes: dict[str, Any] = {}
        if isinstance(element, (Body, Drive)):
            k = ends[element.name]
            if k < system.n:
                changes["velocity"] = float(y[k])
            if k in system.position_state:
                changes["position"] = float(y[system.position_state[k]])
        elif isinstance(element, Contact):
            j = rows[element.name]
            changes["rested"] = rested.get(element.name, 0.0)
            if j in system.bristle_state:
                changes["deflection"] = float(y[system.bristle_state[j]])
            changes["slipping"] = bool(abs(modes[j]) == 1 and not system.hard[j])
        elif isinstance(element, (Block, StateSpace)):
            place = system.blocks[element.name]
            changes["states"] = y[place.first : place.end].tolist()
        one: Any = element
        elements.append(replace(one, **changes) if changes else one)
    return Scene(*elements, motion=scene.motion)


# -- the search --------------------------------------------------------------------------------------------------


def _closed(shot: Shot) -> Cycle:
    """Return the cycle to which Newton's method leads from a shot.

    Raises
    ------
    CycleError
    """
    enough = shot.enough
    best: Shot | None = None
    errors: list[float] = []
    for _ in range(_MOST_STEPS):
        if best is not None and not shot.error < best.error and best.error <= enough:
            break
        best = shot if best is None or shot.error < best.error else best
        errors.append(best.error)
        stalls = len(errors) > _PATIENCE and errors[-1] > 0.3 * errors[-1 - _PATIENCE]
        if shot.error <= _SURE * shot.enough or stalls:
            break
        change, longer = shot.solve(-shot.missed)
        following = _nearer(shot, change, longer)
        if following is None:
            break
        shot = following
    assert best is not None
    if best.error > enough:
        raise CycleError(
            f"no cycle was found: Newton's method comes to a standstill where the motion over {best.period:.6g} s "
            f"misses its start by {best.error:.2g} of its size; begin nearer to the cycle (transient=..., guess=...)"
        )
    return cycle_of(best)


def _nearer(shot: Shot, change: Array, longer: float) -> Shot | None:
    """Return the shot after a step of Newton's method, shortened until it misses less; None where that fails."""
    part = 1.0
    if not shot.forced and abs(longer) > 0.5 * shot.period:
        part = 0.5 * shot.period / abs(longer)
    found: Shot | None = None
    for _ in range(_MOST_HALVINGS):
        try:
            one = shot.moved(part * change, part * longer)
        except (SimulationError, CycleError):
            part *= 0.5
            continue
        if found is None or one.error < found.error:
            found = one
        if one.error < shot.error:
            return one
        if shot.error <= 1e-9:
            return None
        part *= 0.5
    return found


def cycle_of(shot: Shot) -> Cycle:
    """Return the cycle that a shot which closes is.

    Raises
    ------
    CycleError
        If it does not move, or the map over one period has no derivative.
    """
    _check_moves(shot)
    return Cycle(
        shot.period,
        shot.multipliers(),
        shot.scene,
        shot.result,
        sequence_of(shot.result),
        shot.forced,
        shot.error,
        shot,
    )


def centred(cycle: Cycle) -> Cycle:
    """Return a cycle of free period that starts in the middle of its longest motion; others as they are."""
    if cycle.forced:
        return cycle
    shot = cycle.shot
    return cycle_of(Shot(_middle(cycle.result, 0.0, cycle.period), cycle.period, False, shot.options))


def cycle_within(cycle: Cycle) -> Cycle | None:
    """Return the cycle of the same scene just within one of free period that has lost a phase, None for none.

    Newton's method begins with motions that are a little smaller, and so small that they have lost a phase.
    """
    shot, coordinates = cycle.shot, cycle.shot.coordinates
    states = coordinates.of(cycle.result(np.linspace(0.0, cycle.period, 500)))
    inwards = np.zeros(coordinates.size)
    inwards[: states.shape[0]] = states.mean(axis=1) - coordinates.of(shot.start)
    for part in _INWARDS:
        smaller = shot.moved(part * inwards, 0.0)
        if len(smaller.result.events) >= len(cycle.sequence):
            continue
        try:
            found = centred(_closed(smaller))
        except (CycleError, SimulationError):
            continue
        if len(found.sequence) < len(cycle.sequence):
            return found
    return None


def closed_from(
    cycle: Cycle, parameter: Parameter, change: float, value: float, longer: float | None
) -> Cycle:
    """Return the cycle near another one whose parameter has changed.

    Parameters
    ----------
    cycle : Cycle
    parameter : Parameter
        Has changed by `change` to `value`.
    longer : float or None
        By how much in s the given period of the loads has changed; None if it has not.

    Raises
    ------
    CycleError
    """
    shot = cycle.shot
    # the derivative at this cycle, not at the first one of a branch
    given = 0.0 if longer is None else longer / change
    along, slower, begin = shot.along(parameter.at(shot.scene), given)
    scene = parameter.set(shot.scene, value)
    period = slower * change if longer is None else longer
    if shot.forced:
        _check_loads(compiled(scene), shot.period + period)
    foretold = shot.moved(along * change, period, scene, shot.start + begin * change)
    found = _closed(foretold)
    off = _apart(found.shot, foretold)
    if off > max(_NEAR_BY, _FAR * _apart(foretold, shot)):
        raise CycleError("the search leads to a cycle far from the one before")
    return found


def _apart(one: Shot, other: Shot) -> float:
    """Return by what part of their size two shots differ in start and period."""
    off = abs(one.period - other.period) / other.period
    if one.coordinates.free.size == other.coordinates.free.size:
        start = other.coordinates.of(one.start) - other.coordinates.of(other.start)
        off = max(off, float(np.abs(start / other.sizes[: start.size]).max(initial=0.0)))
    return off


def _check_moves(shot: Shot) -> None:
    """Refuse a state of rest for a cycle."""
    if shot.forced:
        return
    found = shot.coordinates.of(shot.result.y)
    if np.ptp(found, axis=1).max(initial=0.0) <= 1e-9 * np.abs(found).max(initial=0.0):
        raise CycleError("no cycle was found: the motion comes to a state that does not change")


def sequence_of(result: Result) -> tuple[str, ...]:
    """Return the changes of modes of a result, without their times."""
    return tuple(_said(event) for event in result.events)


def _said(event: Event) -> str:
    before, after = Mode(event.before), Mode(event.after)
    return f"{event.contact}: {before.name} -> {after.name}"


def _settled(scene: Scene, period: float, periods: int, options: dict[str, Any]) -> Scene:
    """Return the scene as it starts after some periods of its loads.

    Raises
    ------
    CycleError
        If the motion only comes back after several periods.
    """
    result = simulated(scene, (0.0, periods * period), **options)
    system: System = result.trajectory.system
    times = period * np.arange(periods + 1)
    states = result(np.minimum(times, result.trajectory.pieces[-1].stop))
    read = _read_positions(system)
    n = system.n
    z = _seen(system, states, read)
    size = np.ptp(_seen(system, result.y, read), axis=1)
    size[:n] = size[:n].max()
    last = n + read.shape[0]
    size[n:last] = size[n:last].max(initial=0.0)
    size[size == 0] = 1.0
    apart = [
        float(np.abs((z[:, -1] - z[:, -1 - k]) / size).max(initial=0.0))
        for k in range(1, min(9, periods // 2))
    ]
    if apart and apart[0] > 1e-3 and min(apart) < 1e-2 * apart[0]:
        k = 1 + next(i for i, one in enumerate(apart) if one < 1e-2 * apart[0])
        raise CycleError(
            f"the motion repeats only after {k} periods of {period:g} s; give period={k * period:.12g} for that cycle, "
            "or begin near another one with transient=0"
        )
    piece = result.trajectory.pieces[-1]
    held = system.dwelling[(piece.labels[system.dwelling] == 0)]
    ages = periods * period - piece.since[held]
    assert piece.path is not None
    return started(scene, system, piece.path.last, held, ages, piece.modes)


def _returning(
    scene: Scene, guess: float | None, transient: float | None, options: dict[str, Any]
) -> tuple[Scene, float]:
    """Return a start near a cycle, and about its period, from a transient."""
    system = compiled(scene)
    span = 2.0 * transient if transient else (_TURNS * guess if guess else _TURNS * _turn(system))
    for trial in range(_TRIES):
        result = simulated(scene, (0.0, span), **options)
        found = _return_of(result, guess)
        if found is not None:
            return found
        if guess is not None and trial and (other := _return_of(result, None)) is not None:
            raise CycleError(
                f"no cycle was found with a period of about {guess:g} s: the motion comes back after {other[1]:.6g} "
                f"s; give guess={other[1]:.6g} for that cycle"
            )
        if _has_ended(result):
            raise CycleError("no cycle was found: the motion comes to a state that does not change")
        span *= _LONGER
    raise CycleError(
        f"no cycle was found: within {span / _LONGER:.6g} s the motion does not come back to where it was "
        "(it may be chaotic or quasi-periodic, or approach its cycle slowly); give transient=... or guess=..."
    )


def _turn(system: System) -> float:
    """Return about the longest time in s in which a scene swings, from its stiffnesses."""
    C = _dense(system.C)[:, system.n : system.first_bristle]
    bodies = [i for i in system.moved.tolist() if system.inertia[i] > 0]
    columns = [system.position_state[i] - system.n for i in bodies]
    if not bodies:
        return 1.0
    values = np.linalg.eigvals(-C[np.ix_(bodies, columns)] / system.inertia[bodies][:, None])
    frequencies = np.sqrt(np.abs(values[np.abs(values) > 1e-12 * np.abs(values).max(initial=0.0)]))
    return float(2 * math.pi / frequencies.min()) if frequencies.size else 1.0


def _has_ended(result: Result) -> bool:
    """Tell whether nothing moves any more against anything."""
    last = result.trajectory.pieces[-1]
    motion = result.trajectory.motion(len(result.trajectory.pieces) - 1)
    assert last.path is not None
    if last.end < 0.5 * (last.stop - result.trajectory.pieces[0].t):
        return False
    read = _read_positions(result.trajectory.system)
    rate = motion.rate(last.end, last.path.last)
    seen = _seen(result.trajectory.system, rate, read)
    size = float(np.abs(result.y).max(initial=0.0)) or 1.0
    return bool(np.abs(seen).max(initial=0.0) <= 1e-9 * size / max(last.end, 1e-300))


def _marks(result: Result) -> tuple[Array, list[str]]:
    """Return times that come back on a cycle and what happens then: events, or else turns of the fastest body."""
    if len(result.events) >= 4:
        return np.array([event.t for event in result.events]), [_said(event) for event in result.events]
    t = np.linspace(result.t[0], result.t[-1], 4000)
    v = result.sample(t).y[: result.trajectory.system.n]
    later = t >= 0.5 * (t[0] + t[-1])
    fastest = int(np.argmax(np.ptp(v[:, later], axis=1)))
    x = v[fastest] - 0.5 * (v[fastest, later].max() + v[fastest, later].min())
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    times = t[up] - x[up] * (t[up + 1] - t[up]) / (x[up + 1] - x[up])
    return times, ["up"] * times.size


def _return_of(result: Result, guess: float | None) -> tuple[Scene, float] | None:
    """Return a start and about the period where the end of a motion has come back to where it was before, else None."""
    times, said = _marks(result)
    count = times.size
    system: System = result.trajectory.system
    read = _read_positions(system)
    for back in range(1, count // 2):
        first, second = count - 1 - back, count - 1 - 2 * back
        if second < 0 or said[first:] != said[second : first + 1]:
            continue
        about, before = times[-1] - times[first], times[first] - times[second]
        if abs(about - before) > _NEAR * about or (guess is not None and abs(about - guess) > 0.3 * guess):
            continue
        states = result(np.array([times[-1], times[first]]))
        z = _seen(system, states, read)
        whole = result.sample(np.linspace(times[first], times[-1], 200)).y
        whole = _seen(system, whole, read)
        if np.abs(z[:, 0] - z[:, 1]).max() > _NEAR * max(float(np.ptp(whole, axis=1).max()), 1e-300):
            continue
        return _middle(result, float(times[first]), float(times[-1])), float(about)
    return None


def _middle(result: Result, begin: float, end: float) -> Scene:
    """Return the scene as it is in the middle of the longest motion between two times."""
    system: System = result.trajectory.system
    pieces = result.trajectory.pieces

    def length(number: int) -> float:
        piece = pieces[number]
        return min(piece.stop, end) - max(piece.t, begin)

    number = max(range(len(pieces)), key=length)
    piece = pieces[number]
    at = 0.5 * (min(piece.stop, end) + max(piece.t, begin))
    y = result(at)
    held = system.dwelling[piece.labels[system.dwelling] == 0]
    return started(result.scene, system, y, held, at - piece.since[held], piece.modes)
