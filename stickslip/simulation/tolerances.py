"""Tolerances from the natural scales of a scene, so that they mean the same whatever the units."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from stickslip.engines.base import LOCAL, Method
from stickslip.equations.algebra.matrices import row_maxima
from stickslip.equations.system import System
from stickslip.events.endings import StepErrors
from stickslip.events.situation import Uncertainty
from stickslip.model.arrays import Array, Mask
from stickslip.model.checks import rounded_up
from stickslip.model.signals import Signal

# Errors of single steps may add up to so many of them, but (unless one error is more) only to this part of a velocity.
_TIMES, _AT_MOST = 100.0, 1e-3

_FINEST = 1e-13
_BRISTLE = 1e-6

_FORCE_UNCERTAINTY = 1e-12  # part of the forces that is uncertain at least
_EXACT = 1e-8  # part of the scene's velocities that an exact engine resolves, whatever the tolerances

# If errors may add up to more than this part of a velocity, they may look like a passing of 0.
_TOO_MUCH = 0.1

# An absolute tolerance beyond this part of the fastest velocity of a run hides how bodies move. For a state of a block
# the part of its largest size is smaller, because controllers may multiply errors.
_HIDDEN, _HIDDEN_STATE = 1e-5, 1e-6

# A velocity below these bounds is no motion: a part of the majorant of accelerations times the time span, or of the
# velocity scale; and a part of the absolute tolerance.
_NOISE, _SEEN = 1e-11, 1e-3

# Part of the majorant of a stretch that is roundoff. The same part of the majorant of accelerations, times the time
# span, is the smallest absolute tolerance of velocities.
_ROUNDOFF = 1e-15

# Where loads seem to give a part of the scene less than this part of the scene's velocities, they give it no scale:
# loads are read at a few times only, which may miss pulses.
_UNSEEN = 1e-13

_REBOUND = 1e-11  # part of the scene's velocities below which stops do not rebound where the engine is exact


@dataclass(frozen=True)
class ReachedSizes:
    """The sizes that a run has reached."""

    velocity_changes: Array  # (n,): largest change of each body's velocity since the start in m/s or rad/s
    distances: Array  # for each position among the states: how far it was from its start in m or rad
    bristle_changes: Array  # (b,): largest change of each deflection since the start in m or rad
    # bounds of the states of blocks; 0 for those that have not changed, that a solver does not integrate, or whose
    # roundoff is not known
    blocks: Array
    velocity_majorant: float  # largest majorant of an acceleration, times the time span, in m/s or rad/s
    block_majorants: Array  # majorants of the rates of the states of blocks, times the time span


@dataclass(frozen=True)
class Tolerances:
    """The tolerances that a solver is asked for, and what they leave uncertain."""

    rtol: float
    atol: Array  # (size,): for each state
    # (m,): relative velocities in m/s or rad/s below which contacts may be found to have relaxed to rest
    margin: Array
    margin_is_given: bool  # whether the user gave that margin; then stops do not rebound below it, either
    velocity_resolution: Array  # (m,): relative velocities in m/s or rad/s that the tolerances do not resolve
    force_uncertainty: float  # part of the forces that is uncertain
    speed: float  # velocity scale in m/s or rad/s
    speeds: Array  # (n,): the same of each body
    system: System
    # whether velocities have errors where they pass 0: not with exact engines, nor with fixed steps, which place
    # events at their ends
    has_errors: bool
    guessed: Mask  # (n,): bodies whose velocity scale follows from loads only

    @property
    def scale(self) -> Array:
        """The sizes (size,) that states at rest are taken to have; 0 for those of blocks, whose scale is not known."""
        found = self.atol / self.rtol
        found[self.system.first_block :] = 0.0
        return np.asarray(found)

    @property
    def may_hide(self) -> bool:
        """Whether tolerances may hide what a run does: if a velocity scale follows from loads only, or with blocks."""
        return self.has_errors and (bool(self.guessed.any()) or self.atol.size > self.system.first_block)

    def hide(self, reached: ReachedSizes) -> bool:
        """Tell whether a run was so much slower than its loads suggest that the tolerances hide it.

        Either the absolute tolerance hides how bodies move, or how states of blocks change, or errors may add up to a
        large part of a velocity.
        """
        hidden = self.atol[self.system.first_block :] / _HIDDEN_STATE
        if np.any((_NOISE * reached.block_majorants < reached.blocks) & (reached.blocks < hidden)):
            return True
        velocities, n = reached.velocity_changes, reached.velocity_changes.size
        atol, speed = float(self.atol[:n].max(initial=0.0)), float(velocities.max(initial=0.0))
        noise = max(_NOISE * max(reached.velocity_majorant, self.speed), _SEEN * atol)
        if self.guessed.all() and noise < speed < atol / _HIDDEN:
            return True
        slow = self.guessed & (velocities > noise)
        return bool(np.any(self._errors(self.speeds)[slow] > _TOO_MUCH * velocities[slow]))

    def relaxation_margin(self, fastest: Array) -> Array:
        """Return the `margin`, or less: scales that follow from loads only are cut off at the `fastest` velocities."""
        if self.margin_is_given or not self.guessed.any():
            return self.margin
        return row_maxima(self.system.abs_G * self._errors(self._so_far(fastest)))

    def slowest_rebound(self, fastest: Array) -> Array:
        """Return relative velocities (m,) below which stops do not rebound.

        An exact engine knows velocities to roundoff: even small rebounds are real.
        """
        if self.margin_is_given or self.has_errors:
            return self.relaxation_margin(fastest)
        return row_maxima(self.system.abs_G * (_REBOUND * self._so_far(fastest)))

    def step_errors(self, y: Array) -> StepErrors | None:
        """Return by how much a step of the solver may err in the states `y`, None where the engine is exact."""
        if not self.has_errors:
            return None
        least = LOCAL * self.atol
        return StepErrors(least, least + LOCAL * self.rtol * np.abs(y))

    def _so_far(self, fastest: Array) -> Array:
        """Return the velocity scale of each body; where it is a guess, no more than the `fastest` velocities so far."""
        if not self.guessed.any():
            return self.speeds
        return np.where(self.guessed, np.minimum(self.speeds, self.system.transmission.handed_on(fastest)), self.speeds)

    def _errors(self, speeds: Array) -> Array:
        """Return what errors of steps may add up to in the velocities of bodies with these `speeds` (n,)."""
        return _added_up(self.rtol * speeds + self.atol[: speeds.size], speeds)

    def uncertainty(self, fastest: Array) -> Uncertainty:
        """Return what is uncertain now; `fastest` is the largest velocity of each body so far."""
        passed = None
        if self.has_errors:
            speeds = np.maximum(self.speeds, self.system.transmission.handed_on(fastest))
            passed = row_maxima(self.system.abs_G * self._errors(speeds))
        return Uncertainty(self.velocity_resolution, self.force_uncertainty, passed)


def tolerances(
    system: System,
    start: float,
    stop: float,
    rtol: float,
    atol: float,
    margin: float | None,
    method: Method,
    is_exact: bool,
    reached: ReachedSizes | None = None,
) -> Tolerances:
    """Return tolerances fit for the scene: never looser than asked for.

    The absolute tolerance is tightened to ``rtol V`` where the scene's velocities V are so small that it would hide
    them, and both so that a pre-slip velocity is ``method.resolution`` times what they leave uncertain. V is what an
    earlier run has `reached`, or what velocities at the start, drives and forces let expect.

    A pre-slip velocity that is too small for double precision is refused.
    """
    speed, frequency, is_guess = _speed(system, start, stop)
    if reached is not None and is_guess:
        speed = float(reached.velocity_changes.max(initial=0.0))
    # the smallest pre-slip velocity
    finest = float(system.laws.resolution[system.alive].min(initial=math.inf))
    resolution, noise = method.resolution, 0.0 if reached is None else _ROUNDOFF * reached.velocity_majorant
    if speed > 0:
        atol = min(atol, max(rtol * speed, noise))
        if resolution * (rtol * speed + atol) > finest:
            rtol = min(rtol, finest / (2 * resolution * speed))
            atol = min(atol, finest / (2 * resolution))
            if rtol < _FINEST:
                raise _unresolved(system, finest, speed, resolution)
    has_errors = not (is_exact or method.takes_steps)
    speeds, guessed = _speeds(system, start, stop, speed, is_guess)
    if reached is not None:
        speeds = np.where(guessed, system.transmission.handed_on(reached.velocity_changes), speeds)
        guessed = np.zeros(system.n, dtype=bool)
    each = np.full(system.size, atol)
    each[: system.n] = np.where(speeds > 0, np.minimum(atol, np.maximum(rtol * speeds, noise)), atol)
    if speed > 0:
        time = min(stop - start, 1.0 / frequency if frequency else math.inf)
        each[system.n : system.first_bristle] = min(atol, rtol * speed * time)
        moves = speeds[system.moved] > 0
        each[system.moved_state[moves]] = np.minimum(atol, rtol * speeds[system.moved[moves]] * time)
    for j, state in system.bristle_state.items():
        if system.pressed[j]:
            continue
        force = system.mu_s[:, j].max() * largest_value(system.normals[j], start, stop)
        stiffness = system.laws.characters[j].stiffness or 1.0
        if force > 0:
            each[state] = min(atol, _BRISTLE * force / stiffness)
    if reached is not None:
        blocks = np.maximum(rtol * reached.blocks, _ROUNDOFF * reached.block_majorants) * (reached.blocks > 0)
        own = np.concatenate([rtol * reached.distances, rtol * reached.bristle_changes, blocks])
        # a state that has not moved gives no scale
        each[system.n :] = np.where(own > 0, np.minimum(each[system.n :], own), each[system.n :])
    errors, levers = rtol * speeds + each[: system.n], system.abs_G
    force_uncertainty = max(_FORCE_UNCERTAINTY, method.force_uncertainty * rtol)
    relaxes = row_maxima(levers * _added_up(errors, speeds)) if margin is None else np.full(system.m, margin)
    if is_exact:
        # here loose tolerances only decide how soon a velocity that dies away counts as 0
        errors = np.minimum(errors, _EXACT * speeds)
    return Tolerances(
        rtol,
        each,
        relaxes,
        margin is not None,
        row_maxima(levers * errors),
        force_uncertainty,
        speed,
        speeds,
        system,
        has_errors,
        guessed,
    )


def _added_up(error: float | Array, speed: float | Array) -> Array:
    """Return what errors of single steps may add up to in a velocity."""
    return np.asarray(np.minimum(_TIMES * error, np.maximum(_AT_MOST * speed, error)))


def _unresolved(system: System, finest: float, speed: float, resolution: float) -> ValueError:
    names = [row.name for row, v in zip(system.rows, system.laws.resolution, strict=True) if v == finest]
    return ValueError(
        f"contact {names[0]!r}: a pre-slip velocity of {finest:g} is too small beside velocities of {speed:.3g} "
        f"for double precision; make it at least {rounded_up(2 * resolution * _FINEST * speed)}, or use DryFriction"
    )


def _speeds(system: System, start: float, stop: float, speed: float, is_guess: bool) -> tuple[Array, Mask]:
    """Return the velocity scale of each body, and where it is a guess: where it follows from loads only.

    It is the `speed` of the scene, or less where the body's part of the scene is slower; `is_guess` is that of `speed`.
    """
    transmission = system.transmission
    if transmission.is_uniform:
        return np.full(system.n, speed), np.full(system.n, is_guess)
    known, pushed = (
        transmission.handed_on(np.minimum(found, speed))
        for found in (_known(system, start, stop), _pushed(system, start, stop))
    )
    # as for the whole scene, loads count only where nothing else gives a scale
    return np.where(known > 0, known, np.where(pushed > _UNSEEN * speed, pushed, 0.0)), known == 0


def _known(system: System, start: float, stop: float) -> Array:
    """Return the velocities that bodies start with, and those that drives and stretched springs may give them."""
    scene, n = system.scene, system.n
    drives = np.array([largest_value(drive.velocity, start, stop) for drive in scene.drives])
    found = np.array([abs(body.velocity) for body in scene.bodies])
    np.maximum(found, system.transmission.led(drives), out=found)
    for coefficients, stiffness, offset in _stretched(system):
        for i in coefficients:
            if i < n and system.inertia[i]:
                found[i] = max(found[i], offset * math.sqrt(stiffness / system.inertia[i]))
    return found


def _pushed(system: System, start: float, stop: float) -> Array:
    """Return the velocities that loads alone give their bodies; forces that depend on the state are left out."""
    found = np.zeros(system.n)
    for i, load in _loads(system):
        # a function that fails is reported when the run comes to it
        largest = math.inf
        with contextlib.suppress(ValueError):
            largest = largest_value(load, start, stop)
        found[i] = max(found[i], largest / system.inertia[i] * (stop - start))
    return found


def _loads(system: System) -> Iterator[tuple[int, Signal]]:
    """Return the loads on bodies with inertia, each with the number of its body before it."""
    forces = system.scene.forces
    for force, load in zip(forces, system.others[: len(forces)], strict=True):
        i = system.index[force.body]
        if system.inertia[i] > 0:
            yield i, load


def _stretched(system: System) -> Iterator[tuple[Mapping[int, float], float, float]]:
    """Return the coefficients of springs and gaps, their stiffnesses, and how far they are from rest at the start."""
    scene = system.scene
    place = [element.position for element in (*scene.bodies, *scene.drives)]

    def beyond(limit: float, coefficients: Mapping[int, float]) -> float:
        """Return how far a stretch is beyond a limit, 0 where that is roundoff."""
        parts = [-limit, *(c * place[i] for i, c in coefficients.items())]
        found = sum(parts)
        return float(found) if abs(found) > _ROUNDOFF * sum(map(abs, parts)) else 0.0

    for link in system.couplings:
        if link.stiffness:
            yield link.coefficients, link.stiffness, abs(beyond(link.rest, link.coefficients))
    for gap, j in zip(scene.gaps, system.is_gap.nonzero()[0].tolist(), strict=True):
        coefficients = system.rows[j].coefficients
        above, below = (beyond(x, coefficients) if math.isfinite(x) else 0.0 for x in (gap.upper, gap.lower))
        # damping is at most as large as the spring force: where it is clipped, a gap is twice as stiff
        yield coefficients, 2 * gap.stiffness, max(above, -below, 0.0)


def _speed(system: System, start: float, stop: float) -> tuple[float, float, bool]:
    """Return the velocity scale, the highest natural frequency (rad/s, 0 without springs), and if the scale is a guess.

    It is a guess where it follows from loads only.
    """
    scene = system.scene
    total, stretched = np.zeros(system.n + system.drives), 0.0
    for coefficients, stiffness, offset in _stretched(system):
        # the stretch as a displacement of the body with the shortest lever
        stretched = max(stretched, offset / min(map(abs, coefficients.values())))
        for i, c in coefficients.items():
            total[i] += stiffness * c * c
    heavy = system.inertia > 0
    squared = 2 * total[: system.n][heavy] / system.inertia[heavy]
    frequency = float(np.sqrt(squared.max(initial=0.0)))
    speeds = [abs(body.velocity) for body in scene.bodies]
    speeds += [largest_value(drive.velocity, start, stop) for drive in scene.drives]
    speeds.append(frequency * stretched)
    known = max(speeds)
    return known or _forced(system, start, stop, frequency), frequency, known == 0


def _forced(system: System, start: float, stop: float, frequency: float) -> float:
    """Return the largest velocity that a load alone gives its body until a spring, a damper or the end stops it."""
    damping = np.zeros(system.n + system.drives)
    for link in system.couplings:
        for i, c in link.coefficients.items():
            damping[i] += link.damping * c * c
    found, time = 0.0, min(stop - start, 1.0 / frequency if frequency else math.inf)
    for i, load in _loads(system):
        resistance = max(system.inertia[i] / time, damping[i])
        found = max(found, largest_value(load, start, stop) / resistance)
    return found


def largest_value(signal: Signal, start: float, stop: float) -> float:
    """Return the largest absolute value at the breaks and at a few times between."""
    times = [*np.linspace(start, stop, 17).tolist(), *signal.breaks(start, stop)]
    return max(abs(signal.at(t)) for t in times)
