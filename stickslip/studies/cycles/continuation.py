"""Follow limit cycles over a parameter: from value to value, round folds, and to where a branch ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from inspect import signature
from itertools import pairwise
from typing import Any

import numpy as np
from tqdm import tqdm

from stickslip.model.arrays import Array
from stickslip.model.checks import check_takes, finite, flag, numbers
from stickslip.model.scene import Scene
from stickslip.simulation.arguments import between
from stickslip.studies.cycles.branches import Branch, BranchPoint
from stickslip.studies.cycles.cycle import Cycle, centred, from_zero
from stickslip.studies.cycles.newton import closed_from, cycle_within
from stickslip.studies.cycles.phases import alike, vanishing
from stickslip.studies.cycles.points import Reached, points_between
from stickslip.studies.cycles.pseudo_arclength import ERRORS, Arc, Place
from stickslip.studies.cycles.search import limit_cycle, single_turn
from stickslip.studies.cycles.shooting import CycleError
from stickslip.studies.parameters import Parameter, named_parameters

_SHORTEST_STEP = 1 / 256  # shortest step from value to value, as a part of their distance

# First and shortest step along an arc, as parts of the distance between two values; most steps, and most folds.
_FIRST, _SHORTEST, _MOST_PLACES, _MOST_FOLDS = 0.25, 1e-3, 200, 6

# A cycle meets the end of a branch if it differs from the cycle there by less than the first part. It is looked for at
# so many values.
_MEETS, _LOOKS = 0.02, 14

# Part of the way from a fold to the next value on which another sequence of modes means the other branch.
_NEAR_FOLD = 0.1

_SHRUNK = 0.05  # a cycle whose speeds have shrunk to this part is about to become a state of rest
_SHRINKS = "the cycles shrink to a state of rest (a Hopf bifurcation)"

# Part of the way left to the end of a branch that is tried as a step where half of the way fails.
_SHORT_STEP = 1 / 8

_GROWN = 10.0  # a period so many times as long as at the last value grows without bound
_SAME = 1e-6  # the way back leads to the same cycle if the period differs by no more than this part


def continue_cycle(
    scene: Scene | Cycle,
    parameter: str,
    values: Sequence[float] | Array,
    *,
    period: float | Callable[[float], float] | None = None,
    accuracy: float = 1e-6,
    progress: bool = False,
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
    progress : bool
        Show progress bars.
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
            f"continue_cycle: {parameter!r} says where a motion starts, and a cycle may start anywhere on it: name "
            "another one, as the rest length of a spring or a limit of a stop for the place of a drive"
        )
    wanted = numbers(values, "continue_cycle: values")
    if not np.isfinite(wanted).all():
        raise ValueError(f"continue_cycle: values must be finite, got {values!r}")
    steps = np.diff(wanted)
    if not wanted.size or not (np.all(steps > 0) or np.all(steps < 0)):
        raise ValueError(f"continue_cycle: values must rise or fall, got {values!r}")
    for value in wanted.tolist():
        try:
            one.set(own, value)
        except (ValueError, TypeError) as error:
            raise ValueError(
                f"continue_cycle: {parameter!r} cannot be {value:g} ({error}); leave that value out"
            ) from None
    if callable(period):
        check_takes(period, 1, "continue_cycle: period", "a value of the parameter")
    elif period is not None:
        period = finite(period, "continue_cycle: period")
    _check_options(scene, options)
    accuracy = between("accuracy", accuracy, 0.0, 1.0, "continue_cycle")
    follower = Follower(one, period, accuracy, progress=flag(progress, "continue_cycle: progress"))
    if isinstance(scene, Cycle):
        first = follower.reached(Reached(scene, one.value), float(wanted[0])).cycle
    else:
        at = follower.period(float(wanted[0]))
        first = limit_cycle(one.set(scene, float(wanted[0])), period=at, **options)
    return follower.follow(centred(first), wanted)


def _check_options(scene: Scene | Cycle, options: dict[str, Any]) -> None:
    """Refuse options that `limit_cycle` does not know, and all options if a cycle is given."""
    if options and isinstance(scene, Cycle):
        listed = ", ".join(f"{name}=" for name in options)
        raise TypeError(f"continue_cycle: {listed} would find a first cycle, but one was given; leave it out")
    known = [name for name in signature(limit_cycle).parameters if name not in ("scene", "period")]
    for name in options:
        if name not in known:
            raise TypeError(f"continue_cycle: there is no option {name!r}; known are {', '.join(known)}")


class Follower:
    """Follows cycles from value to value."""

    def __init__(
        self,
        parameter: Parameter,
        period: float | Callable[[float], float] | None,
        accuracy: float,
        folds: int = _MOST_FOLDS,
        progress: bool = False,
    ) -> None:
        self._parameter, self._period, self._accuracy, self._folds = parameter, period, accuracy, folds
        self._progress, self._name = progress, "beyond a fold" if folds < _MOST_FOLDS else "branch"
        self._points: list[BranchPoint] = []

    def period(self, value: float) -> float | None:
        """Return the period of the loads at a value."""
        if not callable(self._period):
            return self._period
        return finite(self._period(value), f"continue_cycle: period({value:g})")

    def follow(self, first: Cycle, values: Array, every: Array | None = None, first_step: float = 1.0) -> Branch:
        """Return the branch that begins with a cycle at the first of some values.

        Beyond a fold it goes back over `every` value, by default the same ones. The first step is a part of the way to
        the second value.
        """
        cycles, beyond = [first], None
        ways = list(pairwise(values.tolist()))
        for before, value in tqdm(ways, disable=not self._progress, unit="value", desc=self._name):
            last = Reached(cycles[-1], before)
            near = self._toward(last, value, first_step)
            first_step = 1.0
            found: Cycle | Branch | None = near.cycle
            if near.why:
                found = self._past(near, last, value, values if every is None else every)
            if not isinstance(found, Cycle):
                beyond = found
                break
            self._note_between(last, Reached(found, value))
            cycles.append(found)
        every_cycle = [*map(from_zero, cycles), *[None] * (values.size - len(cycles))]
        return Branch(self._parameter.name, values, tuple(every_cycle), tuple(self._points), beyond)

    def _note_between(self, a: Reached, b: Reached) -> None:
        """Note what changes from one cycle to another."""
        self._points += points_between(a, b, self._accuracy * abs(b.value - a.value), self.reached)

    def reached(self, start: Reached, value: float, carefully: bool = False) -> Reached:
        """Return the cycle at a value from that at another one, by smaller steps where it has to be."""
        found = self._toward(start, value, carefully=carefully)
        if found.why:
            raise CycleError(found.why)
        return found

    def _toward(self, start: Reached, value: float, first: float = 1.0, carefully: bool = False) -> Reached:
        """Return how far the way to a value leads; the first step is the part `first` of it."""
        cycle, at = start.cycle, start.value
        # a step below the spacing of floats leads nowhere
        least = float(np.spacing(max(abs(at), abs(value))))
        step, failed = math.copysign(max(first * abs(value - at), least), value - at), False
        shortest = max(_SHORTEST_STEP * abs(step), least)
        # just beyond a fold both branches are so near that the way back does not show which one was reached
        beyond = at + _NEAR_FOLD * (value - at) if first < 1.0 else at
        while at != value:
            aim = value if abs(value - at) <= abs(step) * (1 + 1e-9) else at + step
            try:
                following = self._step(cycle, at, aim, carefully)
                if not alike(following, cycle):
                    if following.neutral and not cycle.neutral:
                        raise CycleError("the search leads to a family of cycles (a multiplier is 1)")
                    if (beyond - aim) * (value - at) > 0:
                        raise CycleError("the search leads to the other branch of a fold")
                    self._check_way_back(following, aim, cycle, at)
            except ERRORS as error:
                step *= 0.5
                failed = True
                if abs(step) < shortest:
                    return Reached(cycle, at, str(error), aim)
                continue
            cycle, at = following, aim
            step, failed = step if failed else 2 * step, False
        return Reached(cycle, at)

    def _check_way_back(self, following: Cycle, aim: float, cycle: Cycle, at: float) -> None:
        """Refuse a cycle of another sequence of modes that does not lead back: it belongs to another branch."""
        back = self._step(following, aim, at)
        if abs(back.period - cycle.period) > _SAME * cycle.period or not alike(back, cycle):
            raise CycleError("the search leads to another branch of cycles")

    def _step(self, cycle: Cycle, before: float, value: float, carefully: bool = False) -> Cycle:
        if value == before:
            return cycle
        given = self.period(value)
        longer = None if given is None else given - cycle.period
        following = centred(closed_from(cycle, self._parameter, before, value, longer, carefully))
        if single_turn(following) is not None and single_turn(cycle) is None:
            raise CycleError("the cycle becomes a shorter one that is run through several times")
        return following

    # -- where it does not go on -------------------------------------------------------------------------------

    def _past(self, near: Reached, last: Reached, value: float, every: Array) -> Cycle | Branch | None:
        """Return the cycle at a value to which no small steps lead, or the branch beyond the end before it.

        That is the branch beyond a fold, or a branch of cycles without the phase that vanishes at the end; None for
        none.
        """
        spacing = value - last.value
        turned = None if vanishing(near.cycle) else self._round(near, value, spacing)
        if isinstance(turned, Cycle):
            return turned
        if turned is None:
            return self._past_end(near, last, value, every)
        fold, place = turned
        self._note_between(last, near)
        if _has_shrunk(fold.cycle, near.cycle):
            # beyond the state of rest the arc has the same cycles again, half a period later
            self._points.append(BranchPoint(fold.value, "end", _SHRINKS, from_zero(near.cycle)))
            return None
        said = "a multiplier is 1: two cycles meet, and the branch turns back"
        self._points.append(BranchPoint(fold.value, "fold", said, from_zero(fold.cycle)))
        apart = abs(place.value - fold.value)
        return self._beyond(Reached(place.cycle, place.value), apart, last.value, spacing > 0, every)

    def _past_end(self, near: Reached, last: Reached, value: float, every: Array) -> Cycle | Branch | None:
        """Return what `_past` does where there is no smooth fold: look for the end, and for a branch that goes on."""
        spacing = value - last.value
        # a step that was too long does not show where the branch ends
        passed, other = self._last(near._replace(end=value), self._accuracy * abs(spacing))
        a, at, why, end = passed[-1]
        phases, inner = vanishing(a), None
        if a.period > _GROWN * last.cycle.period:
            phases, why = [], "the period grows without bound"
        if other is None and phases and not a.forced:
            inner = self._within(passed)
        shrunk = inner is None and _has_shrunk(a, last.cycle)
        if inner is None and not shrunk:
            further = self._toward(other or passed[-1], value)
            if not further.why:
                return further.cycle
            if phases and other is not None and _differ(a, other.cycle) < _MEETS:
                inner = other
        self._note_between(last, passed[-1])
        goes_on = inner is not None and not inner.cycle.neutral
        if goes_on:
            why = "cycles without it begin there, and the branch turns back"
        elif inner is not None:
            why = "the branch ends in a family of cycles without it (a multiplier is 1)"
        elif shrunk:
            why = _SHRINKS
        elif phases:
            why += (
                ". Cycles without it may begin there: start them from limit_cycle(scene, transient=0, guess=...) "
                "of a scene that moves a little less"
            )
        kind, said = "fold" if goes_on else "end", "; ".join([*phases, why])
        self._points.append(BranchPoint(0.5 * (at + end), kind, said, from_zero(a)))
        if inner is None or not goes_on:
            return None
        # the fold is somewhere between the last cycle and the end
        apart = max(abs(inner.value - at), abs(inner.value - end))
        return self._beyond(inner, apart, last.value, spacing > 0, every)

    def _beyond(self, first: Reached, apart: float, before: float, rose: bool, every: Array) -> Branch | None:
        """Return the branch that goes back over the values from a cycle beyond a fold.

        The first step is as long as the cycle is `apart` from the fold: there both branches are so near to each other
        that a longer one could lead to the other branch.
        """
        if self._folds <= 0:
            return None
        back = np.sort(every[(every <= before) if rose else (every >= before)])
        back = back[::-1] if rose else back
        follower = Follower(self._parameter, self._period, self._accuracy, self._folds - 1, self._progress)
        part = min(apart / max(abs(before - first.value), np.finfo(float).tiny), 1.0)
        found = follower.follow(centred(first.cycle), np.array([first.value, *back]), every, part)
        return replace(found, values=found.values[1:], cycles=found.cycles[1:])

    def _last(self, near: Reached, smallest: float) -> tuple[list[Reached], Reached | None]:
        """Return by bisection the last cycles before the end of a branch, and one of another sequence beyond it."""
        passed, other = [near], None
        way = near.end - near.value
        refused: set[float] = set()
        while abs(way) > smallest and near.value + 0.5 * way not in (near.value, near.end):
            # a long step may lead elsewhere where a short one does not
            for value in (near.value + 0.5 * way, near.value + _SHORT_STEP * way):
                if value in refused:
                    continue
                try:
                    one = self._step(near.cycle, near.value, value)
                except ERRORS as error:
                    near = near._replace(why=str(error))
                    refused.add(value)
                    continue
                if alike(one, near.cycle):
                    near = near._replace(cycle=one, value=value)
                    passed.append(near)
                    way = near.end - near.value
                    refused = set()
                    break
                other = Reached(one, value)
            else:
                way *= 0.5
                near = passed[-1] = near._replace(end=near.value + way)
        return passed, other

    def _within(self, passed: list[Reached]) -> Reached | None:
        """Return a cycle without the phase that vanishes at the end of a branch, and its value; None for none.

        Where a phase vanishes because a relative velocity only just comes to 0, other cycles may go on from there whose
        relative velocity does not come to 0: they move a little less. At the end both are the same. So the search
        starts nearest to the end and goes back, until the two differ enough to be told apart.
        """
        for own, at, *_ in passed[: -1 - _LOOKS : -1]:
            try:
                one = cycle_within(own)
            except ERRORS:
                continue
            if one is not None and _differ(own, one) < _MEETS:
                return Reached(one, at)
        return None

    def _round(self, near: Reached, value: float, spacing: float) -> tuple[Place, Place] | Cycle | None:
        """Follow the arc from a cycle on: to a fold and just beyond it, or to the value; None where it ends."""
        arc = Arc(self._parameter, self._period if callable(self._period) else None, spacing)
        try:
            place, length = arc.begin(near.cycle, near.value, spacing > 0), _FIRST
            for _ in range(_MOST_PLACES):
                try:
                    following = arc.step(place, length)
                    if not alike(following.cycle, near.cycle):
                        raise CycleError("the arc leads to another sequence of modes")
                except ERRORS:
                    length *= 0.5
                    if length < _SHORTEST:
                        return None
                    continue
                if following.pace * place.pace <= 0:
                    return arc.fold(place, length), following
                if (following.value - value) * place.pace >= 0:
                    return self.reached(Reached(following.cycle, following.value), value).cycle
                if vanishing(following.cycle):
                    return None
                place, length = following, min(1.5 * length, 1.0)
        except ERRORS:
            return None
        return None


def _speed(cycle: Cycle) -> float:
    """Return the range of the fastest velocity of a cycle."""
    found = cycle.result.fit_for_plot(2000)
    return max(float(np.ptp(found.velocity(body.name))) for body in cycle.scene.bodies)


def _has_shrunk(cycle: Cycle, before: Cycle) -> bool:
    """Tell whether a cycle is about to become a state of rest, by its speeds beside those of one before."""
    return _speed(cycle) < _SHRUNK * _speed(before)


def _differ(one: Cycle, other: Cycle) -> float:
    """Return by what part two cycles differ in their period and in the range of their fastest velocity."""
    pairs = [(_speed(one), _speed(other)), (one.period, other.period)]
    return max(abs(a - b) / max(a, b) for a, b in pairs)
