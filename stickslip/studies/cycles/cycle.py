"""Limit cycles: periodic motions, their multipliers, and whether they are stable."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from stickslip.model.arrays import Array, Complex
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results.outcome import Event
from stickslip.simulation.result import Result
from stickslip.studies.cycles.periodicity import scene_at
from stickslip.studies.cycles.shooting import CycleError, Shot
from stickslip.studies.parameters import named_parameters

_REAL = 1e-9  # a multiplier whose imaginary part is no larger is shown as a real number
_NEUTRAL = 1e-6  # a multiplier whose modulus is within this distance from 1 shows neither growth nor decay


@dataclass(frozen=True, eq=False)
class Cycle:
    """A periodic motion.

    Attributes
    ----------
    period : float
        In s.
    multipliers : array of complex
        Of the map over one period, largest first: by what factors small deviations grow. Where the period is free, the
        multiplier 1 of a shift along the motion is left out. A phase in which a contact sticks makes one of them 0.
    scene : Scene
        The scene, starting on the cycle at t = 0.
    result : Result
        One period of it.
    sequence : tuple of str
        The changes of modes in one period, in order.
    forced : bool
        Whether the loads set the period.
    closes : float
        How far the motion is from its start after one period, as a part of its size.
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
        """Whether small deviations die away: all multipliers are smaller than 1, by more than their errors."""
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
            If the cycle is not single (a multiplier is 1: a fold, or a family), or a derivative does not exist.
        """
        named = named_parameters(self.scene, parameters, "Cycle.sensitivities")
        return np.array([self.shot.slopes_along_branch(one)[1] for one in named])

    def _repr_html_(self) -> str:
        """Return one period as a figure, and the multipliers, as notebooks show them."""
        from stickslip.plots.notebook import cycle_html

        return cycle_html(self)

    def __str__(self) -> str:
        """Return period, stability, multipliers and changes of modes as text."""
        kind = "stable" if self.stable else "neutral" if self.neutral else "unstable"
        lines = [f"period {self.period:.12g} s{' (given)' if self.forced else ''}, {kind}"]
        for one in self.multipliers:
            said = f"{one.real:.9g}" if abs(one.imag) <= _REAL else f"{one.real:.9g} {one.imag:+.9g}i"
            lines.append(f"multiplier {said}, modulus {abs(one):.9g}")
        if self.sticks and np.any(self.multipliers == 0):
            lines.append("a contact sticks: in one direction the motion forgets what was before (multiplier 0)")
        return "\n".join([*lines, *self.sequence])


def cycle_of(shot: Shot) -> Cycle:
    """Return the cycle of a shot that closes.

    If it does not move, or the map over one period has no derivative, that is a `CycleError`.
    """
    if not shot.forced:
        found = shot.coordinates.of(shot.result.y)
        if np.ptp(found, axis=1).max(initial=0.0) <= 1e-9 * np.abs(found).max(initial=0.0):
            raise CycleError("no cycle was found: the motion comes to a state that does not change")
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
    """Return a cycle that starts well within its longest motion, so that events do not pass its start."""
    return cycle if cycle.shot.starts_within else cycle_of(cycle.shot.between_events())


def from_zero(cycle: Cycle) -> Cycle:
    """Return a forced cycle with the scene and the result that start at t = 0; others as they are."""
    shot = cycle.shot
    if not shot.begin:
        return cycle
    scene = scene_at(shot.result, shot.period)
    result = Shot(scene, shot.period, True, shot.options).result
    return replace(cycle, scene=scene, result=result, sequence=sequence_of(result))


def sequence_of(result: Result) -> tuple[str, ...]:
    """Return the changes of modes of a result, without their times."""
    return tuple(mode_change(event) for event in result.events)


def mode_change(event: Event) -> str:
    """Return which row changes its mode, and how."""
    before, after = Mode(event.before), Mode(event.after)
    return f"{event.contact}: {before.name} -> {after.name}"
