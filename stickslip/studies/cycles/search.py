"""Search limit cycles: a transient leads near one, and Newton's method to it.

The state z that closes after one period holds velocities, bristles, and of positions only what forces read: bodies may
drift as long as nothing feels it. Multipliers are the eigenvalues of ``dz(T)/dz(0)``, without the 1 that belongs to the
direction of the motion where the period is free.
"""

from __future__ import annotations

import contextlib
import math
from typing import Any, NamedTuple

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.mode_equations import equations_in, where_nothing_sticks
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.model.arrays import Array
from stickslip.model.checks import finite
from stickslip.model.scene import Scene
from stickslip.simulation.result import Result, SimulationError
from stickslip.simulation.simulate import compiled
from stickslip.studies.cycles.cycle import Cycle, from_zero, mode_change
from stickslip.studies.cycles.newton import closed
from stickslip.studies.cycles.periodicity import (
    Closing,
    check_constant,
    check_loads,
    middle_of,
    read_positions,
    scene_at,
)
from stickslip.studies.cycles.shooting import CycleError, Shot
from stickslip.studies.derivatives.variations import simulated

_NEAR = 0.05  # a search begins where a motion comes back to an earlier state within this part of its size

# The first transient lasts _TURNS turns, and each further one is _LONGER times as long; _TRIES of them are tried.
_TURNS, _LONGER, _TRIES = 12, 4.0, 5

# More are tried where a transient has fewer events and steps than these: cycles may be much longer than turns.
_RARE, _MOST_TRIES, _FEW_STEPS = 10, 20, 1000

# Part of the fastest rate of a scene below which another one is roundoff, and factor below which no position is read.
_SLOW, _READ = 1e-6, 1e-6

_MOST_STEPS = 400_000  # a transient that would take more steps is not tried

# A motion comes to rest if velocities in the last quarter of a transient range over less than _SHRINKS of their range
# in the quarter before. It is at rest if they range over less than _DEAD of their range in the whole transient.
_SHRINKS, _DEAD = 0.9, 1e-9

_AWAY = 3  # number of longer transients that are tried to lead away from an unstable cycle

_BACK = 8  # a motion repeats after k periods if it is where it was k periods before, this many times in a row
_MOST_FAILURES = 3  # the search ends when Newton's method has failed after this many transients


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
    it to roundoff. A transient may only pass by an unstable cycle: where the period is free and no `transient` is
    given, longer ones lead on. Unstable cycles are found from a start near them with ``transient=0``.

    Parameters
    ----------
    scene : Scene
    period : float, optional
        Period in s of the loads, or a multiple of it; without it the loads must be constant, and the period is found.
    guess : float, optional
        Approximate period in s, where it is to be found; by default it is read from the transient.
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
        if value is not None and finite(value, f"limit_cycle: {name}") <= 0:
            raise ValueError(f"limit_cycle: {name} must be a positive time in s, got {value:g}")
    if transient is not None and finite(transient, "limit_cycle: transient") < 0:
        raise ValueError(f"limit_cycle: transient must be a time in s, at least 0, got {transient:g}")
    options = {"method": method, "rtol": rtol, "atol": atol}
    system = compiled(scene)
    if system.bristle_state:
        raise ValueError(
            "limit_cycle: cycles of laws with bristles are not searched for; take the DryFriction at their core"
        )
    if system.sampled:
        raise ValueError("limit_cycle: sampled blocks have no derivatives here; blocks in continuous time have")
    if period is not None:
        if guess is not None:
            raise ValueError("limit_cycle: give the period or a guess of it, not both")
        check_loads(system, period)

        def given(start: Scene) -> Cycle:
            return from_zero(closed(Shot(start, period, True, options).between_events()))

        if transient == 0:
            return given(scene)
        periods = 50 if transient is None else max(1, math.ceil(transient / period - 1e-9))
        start = _settled(scene, period, periods, options)
        try:
            return given(start)
        except CycleError:
            # a longer transient leads nearer, or shows that the motion repeats after several periods
            return given(_settled(start, period, int(_LONGER) * periods, options))
    check_constant(system)
    if transient == 0:
        if guess is None:
            raise ValueError("limit_cycle: without a transient give a guess of the period, guess=...")
        return _once(closed(Shot(scene, float(guess), False, options).between_events()))
    return _once(_after_transient(scene, guess, transient, options))


def _once(cycle: Cycle) -> Cycle:
    """Return a single turn of a cycle of free period, where it was found as several turns."""
    shot = single_turn(cycle)
    return cycle if shot is None else closed(shot)


def single_turn(cycle: Cycle) -> Shot | None:
    """Return the shot over a single turn of a cycle that consists of several equal ones; None for others."""
    count = len(cycle.sequence)
    for turns in range(count, 1, -1):
        if count % turns or cycle.sequence != cycle.sequence[: count // turns] * turns:
            continue
        shot = Shot(cycle.shot.scene, cycle.period / turns, False, cycle.shot.options, cycle.shot.begin)
        if shot.error <= 1e3 * shot.tolerance:
            return shot
    return None


def _settled(scene: Scene, period: float, periods: int, options: dict[str, Any]) -> Scene:
    """Return the scene in the state to which it has come after some periods of its loads.

    If the motion only comes back after several periods, that is a `CycleError`.
    """
    result = simulated(scene, (0.0, periods * period), **options)
    closing, times = Closing(result.trajectory.system), period * np.arange(periods + 1)
    z = closing.of(result(np.minimum(times, result.trajectory.pieces[-1].stop)))
    size = np.ptp(closing.of(result.y), axis=1)
    for group in closing.groups:
        size[group] = size[group].max(initial=0.0)
    size[size == 0] = 1.0
    # a motion that comes back by chance does not do so several times in a row
    last = max(1, min(_BACK, periods // 2))
    apart = [
        float(np.abs((z[:, -last:] - z[:, -last - k : -k]) / size[:, None]).max(initial=0.0))
        for k in range(1, min(9, periods // 2))
    ]
    if apart and apart[0] > 1e-3 and min(apart) < 1e-2 * apart[0]:
        k = 1 + next(i for i, one in enumerate(apart) if one < 1e-2 * apart[0])
        raise CycleError(
            f"the motion repeats only after {k} periods of {period:g} s; give period={k * period:.12g} for that cycle, "
            "or begin near another one with transient=0"
        )
    return scene_at(result, periods * period)


def _after_transient(scene: Scene, guess: float | None, transient: float | None, options: dict[str, Any]) -> Cycle:
    """Return the cycle that a transient leads to; an unstable one only if longer transients lead to no other."""
    span = 2.0 * transient if transient else _TURNS * (guess or longest_turn(compiled(scene)))
    first = found = _near(scene, guess, span, options)
    for _ in range(_AWAY if transient is None else 0):
        if not found.passes_by or _LONGER * found.steps > _MOST_STEPS:
            break
        found = found._replace(span=_LONGER * found.span, steps=_LONGER * found.steps)
        with contextlib.suppress(CycleError, SimulationError):
            found = _near(scene, guess, found.span, options, most=1)
    return first.cycle if found.passes_by else found.cycle


class _Found(NamedTuple):
    """A cycle, and the transient that led near to it: its span in s, and its steps."""

    cycle: Cycle
    span: float
    steps: float

    @property
    def passes_by(self) -> bool:
        """Whether a motion near the cycle leaves it again."""
        return not (self.cycle.stable or self.cycle.neutral)


def _near(scene: Scene, guess: float | None, span: float, options: dict[str, Any], most: int = _MOST_TRIES) -> _Found:
    """Return the cycle to which a transient of some span leads, or one of the longer ones that are tried."""
    failures = 0
    for trial in range(most):
        result = simulated(scene, (0.0, span), **options)
        steps = sum(piece.path.taus.size for piece in result.trajectory.pieces if piece.path is not None)
        found = _return_of(result, guess)
        if found is not None:
            try:
                return _Found(closed(Shot(*found, False, options)), span, steps)
            except CycleError as error:
                failures += 1
                if failures == _MOST_FAILURES:
                    if said := _dies_away(result):
                        raise CycleError(
                            f"no cycle was found: the motion {said}: it seems to come to a steady state, and linearize "
                            "tells whether that is stable"
                        ) from error
                    raise
                span *= _LONGER
                continue
        if guess is not None and trial and (other := _return_of(result, None)) is not None:
            raise CycleError(
                f"no cycle was found with a period of about {guess:g} s: the motion comes back after {other[1]:.6g} "
                f"s; give guess={other[1]:.6g} for that cycle"
            )
        if _has_ended(result):
            raise CycleError("no cycle was found: the motion comes to a state that does not change")
        if trial + 1 >= _TRIES and not (len(result.events) < _RARE and steps < _FEW_STEPS):
            break
        if _LONGER * steps > _MOST_STEPS:
            break
        span *= _LONGER
    why = _goes_on(result) or (
        "(it may be chaotic or quasi-periodic, or approach its cycle slowly); give transient=... or guess=..."
    )
    raise CycleError(f"no cycle was found: within {span:.6g} s the motion does not come back to where it was {why}")


def longest_turn(system: System) -> float:
    """Return roughly the longest period in s with which springs or blocks let a scene swing if nothing sticks."""
    y, q = system.at_start(), system.loads(0.0, 1.0).after(0.0)
    regions = system.piecewise.at(y, q.at(0.0), None)
    free = equations_in(where_nothing_sticks(system), system, regions)
    motion = Motion(free, q, 0.0, y, np.zeros(system.m))
    values = np.linalg.eigvals(dense(motion.jacobian(0.0, y)))
    sizes = np.abs(values)
    lasting = sizes > _SLOW * sizes.max(initial=0.0)
    swings = lasting & (np.abs(values.imag) > _SLOW * sizes)
    some = sizes[swings if swings.any() else lasting]
    return float(2 * math.pi / some.min()) if some.size else 1.0


def _has_ended(result: Result) -> bool:
    """Tell whether the motion has come to a state that does not change."""
    last = result.trajectory.pieces[-1]
    motion = result.trajectory.motion(len(result.trajectory.pieces) - 1)
    if last.end < 0.5 * (last.stop - result.trajectory.pieces[0].t):
        return False
    moves = Closing(motion.system).of(motion.rate(last.end, last.kept_path.last))
    size = float(np.abs(result.y).max(initial=0.0)) or 1.0
    return bool(np.abs(moves).max(initial=0.0) <= 1e-9 * size / max(last.end, 1e-300))


def _goes_on(result: Result) -> str:
    """Return in words which position that forces read grows for ever; an empty text if none does."""
    system, start, stop = result.trajectory.system, float(result.t[0]), float(result.t[-1])
    late = np.linspace(0.5 * (start + stop), stop, 5)
    read = np.abs(read_positions(system)).max(axis=0, initial=0.0) > _READ
    steps = np.diff(result.sample(late).y[system.n : system.first_bristle], axis=1)
    # it moves about as far in each eighth of the time; the ends of an eighth may cut a turn
    least, most = np.abs(steps).min(axis=1), np.abs(steps).max(axis=1)
    steady = read & (np.ptp(np.sign(steps), axis=1) == 0) & (least > 0.5 * most)
    bodies = [*system.scene.bodies, *system.scene.drives]
    for i, state in system.position_state.items():
        if steady[state - system.n]:
            speed = float(steps[state - system.n].sum()) / (stop - float(late[0]))
            return (
                f"(the position of {bodies[i].name!r} goes on, by {speed:.3g} in a second, and forces read it: what "
                "comes back a turn further is not searched for)"
            )
    return ""


def _dies_away(result: Result) -> str:
    """Return in words how a motion dies away; an empty text if it does not."""
    t, n = result.t, result.trajectory.system.n
    late = result.sample(np.linspace(t[0] + 0.75 * (t[-1] - t[0]), t[-1], 2000)).y[:n]
    if np.ptp(late, axis=1).max(initial=0.0) <= _DEAD * np.ptp(result.y[:n], axis=1).max(initial=0.0):
        return f"has died away by {t[-1] - t[0]:.6g} s"
    left = left_of(result)
    if left >= _SHRINKS:
        return ""
    return f"shrinks, from the third to the last quarter of {t[-1] - t[0]:.6g} s to {left:.2g} of its size"


def left_of(result: Result) -> float:
    """Return the range of velocities in the last quarter of a motion as a part of that in the quarter before."""
    start, whole, n = float(result.t[0]), float(result.t[-1] - result.t[0]), result.trajectory.system.n
    quarters = (np.linspace(start + a * whole, start + (a + 0.25) * whole, 2000) for a in (0.5, 0.75))
    third, last = (np.ptp(result.sample(times).y[:n], axis=1).max() for times in quarters)
    return float(last / max(third, 1e-300))


def _marks(result: Result) -> tuple[Array, list[str]]:
    """Return times at which a motion may repeat, and their names: events, else turns of the fastest body."""
    middle = 0.5 * (result.t[0] + result.t[-1])
    if len(result.events) >= 4 and result.events[-1].t >= middle:
        return np.array([event.t for event in result.events]), [mode_change(event) for event in result.events]
    # the times fit for a plot show changes that last only a moment
    t = np.unique(np.concatenate([np.linspace(result.t[0], result.t[-1], 4000), result.t]))
    v = result.sample(t).y[: result.trajectory.system.n]
    later = t >= middle
    fastest = int(np.argmax(np.ptp(v[:, later], axis=1)))
    x = v[fastest] - 0.5 * (v[fastest, later].max() + v[fastest, later].min())
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    times = t[up] - x[up] * (t[up + 1] - t[up]) / (x[up + 1] - x[up])
    return times, ["up"] * times.size


def _return_of(result: Result, guess: float | None) -> tuple[Scene, float] | None:
    """Return a start and roughly the period if a motion has come back to an earlier state at its end, else None."""
    times, names = _marks(result)
    count, closing = times.size, Closing(result.trajectory.system)
    for back in range(1, count // 2):
        first, second = count - 1 - back, count - 1 - 2 * back
        if names[first:] != names[second : first + 1]:
            continue
        about, before = times[-1] - times[first], times[first] - times[second]
        if abs(about - before) > _NEAR * about or (guess is not None and abs(about - guess) > 0.3 * guess):
            continue
        z = closing.of(result(np.array([times[-1], times[first]])))
        whole = closing.of(result.sample(np.linspace(times[first], times[-1], 200)).y)
        if np.abs(z[:, 0] - z[:, 1]).max() > _NEAR * max(float(np.ptp(whole, axis=1).max()), 1e-300):
            continue
        at = middle_of(result, float(times[first]), float(times[-1]))
        return scene_at(result, at), float(about)
    return None
