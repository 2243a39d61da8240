"""Branches of limit cycles over a parameter: where they gain or lose stability, change their phases, and end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.model.checks import numbers
from stickslip.model.scene import Scene
from stickslip.simulation.result import SimulationError
from stickslip.studies.arcs import ERRORS, Arc, Place
from stickslip.studies.cycles import Cycle, CycleError, centred, closed_from, limit_cycle, smaller_cycle
from stickslip.studies.parameters import Parameter, named_parameters

__all__ = ["Branch", "BranchPoint", "continue_cycle"]

Array = NDArray[np.float64]

_HALVINGS = 5
_SHORT = 0.02
"""A phase shorter than this part of the period is about to vanish."""

_FIRST, _SHORTEST, _MOST_PLACES, _MOST_FOLDS = 0.25, 1e-3, 200, 6
"""First and shortest step along an arc, in distances of values; how many of them, and how many folds, are followed."""

_BACK = 0.3, 0.6
"""How far before the end of a branch, in distances of values, smaller cycles are looked for."""

_BEFORE, _GRAZES = 1e-4, 0.3
"""A relative velocity that changes by less than this part of its range in a period, just before it is 0, grazes."""


@dataclass(frozen=True)
class BranchPoint:
    """A value of the parameter at which cycles change their kind.

    Attributes
    ----------
    value : float
        Of the parameter.
    kind : str
        "fold" (two cycles meet, and the branch turns back), "crossing" (a multiplier passes 1, and the branch goes on:
        a symmetry breaks, or another branch crosses), "flip" (a multiplier passes -1), "torus" (a pair of them passes
        the unit circle), "sequence" (other changes of modes) or "end" (no cycle near by).
    message : str
        What happens, in words.
    cycle : Cycle or None
        At a fold the cycle there.
    """

    value: float
    kind: str
    message: str
    cycle: Cycle | None = field(default=None, repr=False, compare=False)

    def __str__(self) -> str:
        return f"{self.value:.9g}  {self.kind}: {self.message}"


@dataclass(frozen=True)
class Branch:
    """Limit cycles over a parameter.

    Attributes
    ----------
    parameter : str
    values : array (n,)
        Of the parameter.
    cycles : tuple of Cycle or None
        One for each value, None beyond the end of the branch.
    points : tuple of BranchPoint
        Where the kind of the cycles changes.
    beyond : Branch or None
        The branch beyond a fold, back over the values; None where there is no fold.
    """

    parameter: str
    values: Array
    cycles: tuple[Cycle | None, ...] = field(repr=False)
    points: tuple[BranchPoint, ...]
    beyond: Branch | None = field(default=None, repr=False)

    @cached_property
    def periods(self) -> Array:
        """Periods in s, NaN where there is no cycle."""
        return np.array([np.nan if one is None else one.period for one in self.cycles])

    @cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """Multipliers, one line each."""
        count = max((one.multipliers.size for one in self.cycles if one is not None), default=0)
        found = np.full((len(self.cycles), count), np.nan, dtype=complex)
        for k, one in enumerate(self.cycles):
            if one is not None:
                found[k, : one.multipliers.size] = one.multipliers
        return found

    @cached_property
    def stable(self) -> NDArray[np.bool_]:
        """Whether each cycle is stable."""
        return np.array([one is not None and one.stable for one in self.cycles])

    @property
    def unit(self) -> str:
        """The SI unit of the parameter, empty where it has none or no cycle was found."""
        scenes = (one.scene for one in self.cycles if one is not None)
        return next((named_parameters(s, [self.parameter], "Branch")[0].unit(s) for s in scenes), "")

    def amplitudes(self, body: str) -> Array:
        """Return half of the ranges of a body's position in m or rad, NaN where there is no cycle.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        return np.array([np.nan if one is None else one.amplitude(body) for one in self.cycles])

    def plot(self, body: str | None = None, *, ax: Any = None) -> Any:
        """Draw the bifurcation diagram: the amplitude of a body, or the period, over the parameter.

        Parameters
        ----------
        body : str, optional
            By default the period is drawn.
        ax : matplotlib axes, optional
            By default a new figure.
        """
        from stickslip import plots

        return plots.bifurcation(self, body, ax=ax)

    def __str__(self) -> str:
        """Return a table, and the points where the kind of the cycles changes."""
        lines = [f"{self.parameter:>16}  {'period':>14}  largest multiplier"]
        for value, one in zip(self.values, self.cycles, strict=True):
            if one is None:
                lines.append(f"{value:16.9g}  {'-':>14}")
                continue
            largest = float(np.abs(one.multipliers).max(initial=0.0))
            kind = "" if one.stable else " neutral" if one.neutral else " unstable"
            lines.append(f"{value:16.9g}  {one.period:14.9g}  {largest:.6g}{kind}")
        lines += map(str, self.points)
        return "\n".join(lines if self.beyond is None else [*lines, "beyond the fold", str(self.beyond)])


def continue_cycle(
    scene: Scene | Cycle,
    parameter: str,
    values: Sequence[float] | Array,
    *,
    period: float | Callable[[float], float] | None = None,
    accuracy: float = 1e-6,
    **options: Any,
) -> Branch:
    """Return the branch of limit cycles over values of a parameter.

    Each cycle begins the search for the next one, along the tangent of the branch; steps are halved where the search
    fails. Between two values it is found where a multiplier passes the unit circle, where the sequence of changes of
    modes becomes another one, and where the branch ends. At a fold the branch turns: from there it is followed back
    over the values, by its arc length, and `Branch.beyond` holds what comes.

    Parameters
    ----------
    scene : Scene or Cycle
        The scene, of which `limit_cycle` finds the cycle at the first value, or a cycle at that value: so unstable
        branches are followed, too.
    parameter : str
        Its name, such as ``"belt.velocity"``.
    values : sequence of float
        Rising or falling.
    period : float or function of the value, optional
        Period of the loads in s.
    accuracy : float
        Part of the distance between two values to which the points between them are found.
    **options
        Further arguments of `limit_cycle`.

    Raises
    ------
    ValueError, TypeError
        If an argument is not usable.
    CycleError
        If there is no cycle at the first value.
    """
    if not isinstance(scene, (Scene, Cycle)):
        raise TypeError(f"continue_cycle: scene must be a Scene or a Cycle, got {type(scene).__name__}")
    own = scene.scene if isinstance(scene, Cycle) else scene
    (one,) = named_parameters(own, [parameter], "continue_cycle")
    if one.only_at_start:
        raise ValueError(
            f"continue_cycle: {parameter!r} says where a motion starts; a cycle does not depend on it: name another one"
        )
    wanted = numbers(values, "continue_cycle: values")
    steps = np.diff(wanted)
    if not wanted.size or not (np.all(steps > 0) or np.all(steps < 0)) or not np.isfinite(wanted).all():
        raise ValueError(f"continue_cycle: values must rise or fall, got {values!r}")
    follower = _Follower(one, period, accuracy)
    if isinstance(scene, Cycle):
        first = follower.reach(scene, one.value, float(wanted[0]))
    else:
        at = follower.period(float(wanted[0]))
        first = limit_cycle(one.set(scene, float(wanted[0])), period=at, **options)
    return follower.along(centred(first), wanted)


class _Turned(NamedTuple):
    """A fold, and the place beyond it."""

    fold: Place
    place: Place
    length: float


class _Follower:
    """Follows cycles from value to value."""

    def __init__(
        self,
        parameter: Parameter,
        period: float | Callable[[float], float] | None,
        accuracy: float,
        folds: int = _MOST_FOLDS,
    ) -> None:
        self._parameter, self._period, self._accuracy, self._folds = parameter, period, accuracy, folds
        self._points: list[BranchPoint] = []

    def period(self, value: float) -> float | None:
        """Return the period of the loads at a value."""
        return float(self._period(value)) if callable(self._period) else self._period

    def along(self, first: Cycle, values: Array, every: Array | None = None) -> Branch:
        """Return the branch that begins with a cycle at the first of some values.

        Beyond a fold it goes back over `every` value, by default the same ones.
        """
        cycles: list[Cycle | None] = [first]
        beyond: Branch | None = None
        for before, value in zip(values[:-1].tolist(), values[1:].tolist(), strict=True):
            last = cycles[-1]
            assert last is not None
            try:
                one = self.reach(last, before, value)
            except (CycleError, SimulationError) as error:
                arc = Arc(self._parameter, self._period if callable(self._period) else None, value - before)
                turned = self._round(arc, last, before, value)
                every = values if every is None else every
                if isinstance(turned, _Turned):
                    beyond = self._back(arc, turned, before, every)
                    break
                ended = turned or self._end(last, before, value, str(error), every)
                if not isinstance(ended, Cycle):
                    beyond = ended
                    break
                one = ended
            self._between(last, before, one, value)
            cycles.append(one)
        cycles += [None] * (values.size - len(cycles))
        return Branch(self._parameter.name, values, tuple(cycles), tuple(self._points), beyond)

    def _round(self, arc: Arc, last: Cycle, before: float, value: float) -> _Turned | Cycle | None:
        """Follow the arc from a cycle on: to a fold, or all the way to the value; None where it ends."""
        try:
            place, length = arc.begin(last, before, value > before), _FIRST
            for _ in range(_MOST_PLACES):
                try:
                    following = arc.step(place, length)
                except ERRORS:
                    length *= 0.5
                    if length < _SHORTEST:
                        return None
                    continue
                if following.pace * place.pace <= 0:
                    return _Turned(arc.fold(place, length), following, length)
                if (following.value - value) * (value - before) >= 0:
                    return self.reach(following.cycle, following.value, value)
                place, length = following, min(1.5 * length, 1.0)
        except ERRORS:
            return None
        return None

    def _back(self, arc: Arc, turned: _Turned, before: float, every: Array) -> Branch | None:
        """Note a fold, and return the branch beyond it, back over the values."""
        fold, place, length = turned
        self._points.append(
            BranchPoint(
                fold.value,
                "fold",
                "a multiplier is 1: two cycles meet, and the branch turns back",
                fold.cycle,
            )
        )
        if self._folds <= 0:
            return None
        inner = every[(every <= before) if place.pace < 0 else (every >= before)]
        back = np.sort(inner)[::-1] if place.pace < 0 else np.sort(inner)
        follower = _Follower(self._parameter, self._period, self._accuracy, self._folds - 1)
        none = Branch(self._parameter.name, back, (None,) * back.size, ())
        reached, why = place, ""
        for _ in range(_MOST_PLACES):
            if (place.value - before) * place.pace >= 0:
                try:
                    first = follower.reach(place.cycle, place.value, before)
                except ERRORS as error:
                    why = str(error)
                    break
                found = follower.along(centred(first), back, every)
                follower = _Follower(self._parameter, self._period, self._accuracy)
                follower._between(fold.cycle, fold.value, first, before)
                return replace(found, points=(*follower._points, *found.points))
            try:
                following = arc.step(place, length)
            except ERRORS as error:
                length, why = 0.5 * length, str(error)
                if length < _SHORTEST:
                    break
                continue
            if following.pace * place.pace <= 0:
                why = "the branch turns again: give values that lie closer to each other"
                break
            reached = place = following
            length = min(1.5 * length, 1.0)
        return replace(none, points=(BranchPoint(reached.value, "end", why),))

    def reach(self, cycle: Cycle, before: float, value: float) -> Cycle:
        """Return the cycle at a value from that at another one, by smaller steps where it has to be."""
        at, step, halved = before, value - before, 0
        while at != value:
            aim = value if abs(value - at) <= abs(step) * (1 + 1e-9) else at + step
            try:
                cycle, at = self._step(cycle, at, aim), aim
            except (CycleError, SimulationError):
                halved += 1
                if halved > _HALVINGS:
                    raise
                step *= 0.5
        return cycle

    def _step(self, cycle: Cycle, before: float, value: float) -> Cycle:
        if value == before:
            return cycle
        longer = None
        if (given := self.period(value)) is not None:
            longer = given - cycle.period
        return centred(closed_from(cycle, self._parameter, value - before, value, longer))

    # -- what changes between two values -----------------------------------------------------------------------

    def _between(self, a: Cycle, before: float, b: Cycle, value: float) -> None:
        if _cyclic(a.sequence) != _cyclic(b.sequence):
            self._other_sequence(a, before, b, value)
            return
        for kind, test in (("crossing", _fold), ("flip", _flip), ("torus", _torus)):
            left, right = test(a), test(b)
            if left * right >= 0:
                continue

            def at(x: float, test: Callable[[Cycle], float] = test) -> float:
                near, of = (a, before) if abs(x - before) <= abs(x - value) else (b, value)
                return test(self.reach(near, of, x))

            try:
                found = float(
                    scipy.optimize.brentq(at, before, value, xtol=self._accuracy * abs(value - before))
                )
            except (CycleError, SimulationError):
                found = 0.5 * (before + value)
            said = {
                "crossing": "a multiplier passes 1: a symmetry breaks, or another branch crosses",
                "flip": "a multiplier passes -1: the period doubles",
            }
            self._points.append(
                BranchPoint(found, kind, said.get(kind, "a pair of multipliers passes the unit circle"))
            )

    def _other_sequence(self, a: Cycle, before: float, b: Cycle, value: float) -> None:
        """Find by bisection where the sequence of modes changes."""
        first = _cyclic(a.sequence)
        smallest = self._accuracy * abs(value - before)
        while abs(value - before) > smallest:
            middle = 0.5 * (before + value)
            if middle in (before, value):
                break
            one: Cycle | None = None
            for near, of in ((a, before), (b, value)):
                try:
                    one = self.reach(near, of, middle)
                    break
                except (CycleError, SimulationError):
                    continue
            if one is None:
                break
            if _cyclic(one.sequence) == first:
                a, before = one, middle
            else:
                b, value = one, middle
        said = _told(a, b)
        if abs(value - before) > smallest:
            said += f"; somewhere between {before:.9g} and {value:.9g}"
        self._points.append(BranchPoint(0.5 * (before + value), "sequence", said))

    def _end(self, last: Cycle, before: float, value: float, why: str, every: Array) -> Branch | Cycle | None:
        """Find by bisection how far the branch reaches, and note it; return what comes beyond, None for nothing.

        That is the branch without the phase that vanishes there, or the cycle at the value where it is no end.
        """
        begun, aim, smallest = before, value, self._accuracy * abs(value - before)
        a, first = last, last
        while abs(value - before) > smallest:
            middle = 0.5 * (before + value)
            if middle in (before, value):
                break
            try:
                a, before = self._step(a, before, middle), middle
            except (CycleError, SimulationError) as error:
                value, why = middle, str(error)
        try:
            return self.reach(a, before, aim)
        except (CycleError, SimulationError):
            pass
        if _cyclic(a.sequence) != _cyclic(first.sequence):
            self._points.append(BranchPoint(before, "sequence", _told(first, a)))
        end, vanishing = 0.5 * (before + value), _vanishing(a)
        inner = self._inner(first, begun, before, aim - begun) if vanishing and not a.forced else None
        if inner is None:
            if vanishing:
                why += (
                    ". Cycles without it may begin there: start them from limit_cycle(scene, transient=0, guess=...) "
                    "of a scene that moves a little less"
                )
            self._points.append(BranchPoint(end, "end", "; ".join([*vanishing, why])))
            return None
        said = "; ".join([*vanishing, "cycles without it begin there, and the branch turns back"])
        self._points.append(BranchPoint(end, "fold", said, a))
        if self._folds <= 0:
            return None
        back = every[::-1] if (every[-1] > every[0]) == (aim > begun) else every
        back = back[(back <= begun) if aim > begun else (back >= begun)]
        follower = _Follower(self._parameter, self._period, self._accuracy, self._folds - 1)
        try:
            cycle = follower.reach(inner[0], inner[1], begun)
        except (CycleError, SimulationError) as error:
            none = (None,) * back.size
            return Branch(self._parameter.name, back, none, (BranchPoint(inner[1], "end", str(error)),))
        return follower.along(cycle, back, every)

    def _inner(self, a: Cycle, at: float, end: float, spacing: float) -> tuple[Cycle, float] | None:
        """Return a cycle without the phase that vanishes at the end of a branch, and its value; None for none.

        Where a phase vanishes because a relative velocity only just comes to 0, cycles may go on from there that do
        not come to 0: they move a little less. One counts if it comes nearer to those of the branch towards the end.
        """
        found: list[tuple[Cycle, float]] = []
        apart = []
        try:
            for part in _BACK:
                value = end - part * spacing
                own = self.reach(a, at, value)
                if found:
                    one: Cycle | None = self.reach(found[-1][0], found[-1][1], value)
                else:
                    one = smaller_cycle(own)
                if one is None or _cyclic(one.sequence) == _cyclic(own.sequence):
                    return None
                found.append((one, value))
                apart.append(_speed(own) - _speed(one))
        except (CycleError, SimulationError):
            return None
        return found[0] if 0 < apart[0] < 0.75 * apart[1] else None


def _speed(cycle: Cycle) -> float:
    """Return the range of the fastest velocity of a cycle."""
    found = cycle.result.fit_for_plot(2000)
    return max(float(np.ptp(found.velocity(body.name))) for body in cycle.scene.bodies)


def _fold(cycle: Cycle) -> float:
    return float(np.prod(1.0 - cycle.multipliers).real)


def _flip(cycle: Cycle) -> float:
    return float(np.prod(1.0 + cycle.multipliers).real)


def _torus(cycle: Cycle) -> float:
    pairs = np.abs(cycle.multipliers[np.abs(cycle.multipliers.imag) > 1e-9])
    return float(np.prod(1.0 - pairs[::2])) if pairs.size else 1.0


def _cyclic(sequence: tuple[str, ...]) -> tuple[str, ...]:
    """Return the first of all rotations of a sequence in the order of the alphabet."""
    return min((sequence[k:] + sequence[:k] for k in range(len(sequence))), default=())


def _told(a: Cycle, b: Cycle) -> str:
    """Return in words how the sequence of one cycle becomes that of another."""
    new, old = Counter(b.sequence) - Counter(a.sequence), Counter(a.sequence) - Counter(b.sequence)
    parts = []
    for found, word in ((new, "begins"), (old, "ceases")):
        names = sorted({one.split(":")[0] for one in found})
        for name in names:
            sticks = any(one.startswith(f"{name}:") and "STUCK" in one for one in found)
            both = any(one.split(":")[0] == name for one in new) and any(
                one.split(":")[0] == name for one in old
            )
            if both and word == "ceases":
                continue
            if both:
                parts.append(f"{name!r} changes its order of sticking, reversing and slipping")
            elif sticks:
                parts.append(f"{name!r} {word} to stick (its relative velocity grazes 0)")
            else:
                parts.append(f"{name!r} {word} to reverse (its relative velocity grazes 0)")
    if not parts:
        parts = ["the same changes of modes come in another order"]
    return "; ".join(parts)


def _vanishing(cycle: Cycle) -> list[str]:
    """Return what phase of a cycle is about to vanish, or which relative velocity only just comes to 0."""
    found = []
    events, said = cycle.result.events, cycle.sequence
    for k, event in enumerate(events):
        later = (k + 1) % len(events)
        if len(events) > 1 and (events[later].t - event.t) % cycle.period < _SHORT * cycle.period:
            found.append(f"the phase between '{said[k]}' and '{said[later]}' vanishes")
        if event.cause == "impact":
            speed = np.abs(cycle.result.sample([event.t, cycle.period]).relative_velocity(event.contact)[0])
            if speed < _SHORT * np.ptp(cycle.result.relative_velocity(event.contact)):
                found.append(f"the impact at {event.contact!r} comes to graze")
        elif event.cause == "relative velocity 0" or event.before * event.after < 0:
            before = cycle.result.sample([max(event.t - _BEFORE * cycle.period, 0.0), cycle.period])
            pace = abs(before.relative_velocity(event.contact)[0]) / _BEFORE
            if pace < _GRAZES * np.ptp(cycle.result.relative_velocity(event.contact)):
                found.append(f"the relative velocity of {event.contact!r} comes to graze 0 at '{said[k]}'")
    return found
