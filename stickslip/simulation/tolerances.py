"""Tolerances from the natural scales of a scene, so that they mean the same whatever the units."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass

import numpy as np

from stickslip.engines.base import Method
from stickslip.equations.system import System
from stickslip.events.situation import Uncertainty
from stickslip.model.arrays import Array
from stickslip.model.checks import rounded_up
from stickslip.model.signals import Signal

_TIMES, _AT_MOST = 100.0, 1e-3
"""What errors of steps may add up to: a multiple of what is uncertain, at the most a part of the scene's velocities."""

_FINEST = 1e-13
_BRISTLE = 1e-6

_FORCE_UNCERTAINTY = 1e-12
"""Part of the forces that is uncertain at least."""

_EXACT = 1e-8
"""Part of the scene's velocities that an exact engine resolves, whatever the tolerances."""

_HIDDEN = 1e-5
"""Part of the fastest velocity of a run from which on an absolute tolerance hides how bodies move."""

_APART = 1e-3
"""Parts of a scene that nothing joins may be so many times as slow as the fastest without a tighter tolerance."""

_NOISE, _SEEN = 1e-11, 1e-3
"""What is no motion: a part of what adds up in accelerations, times the span, and a part of an absolute tolerance."""

_ROUNDOFF = 1e-15
"""Part of what adds up in accelerations, times the span, that no absolute tolerance of velocities goes below."""

_REBOUND = 1e-11
"""Part of the scene's velocities below which stops do not rebound where the engine is exact."""


@dataclass(frozen=True)
class Reached:
    """What a run has come to."""

    velocities: Array  # (n,): the fastest of each body in m/s or rad/s
    distances: Array  # (n,): how far each body was from its start in m or rad
    bristles: Array  # (b,): largest deflections in m or rad
    pushed: float  # what adds up in accelerations, times the time span, in m/s or rad/s


@dataclass(frozen=True)
class Tolerances:
    """What the solver is asked for, and what it leaves uncertain."""

    rtol: float
    atol: Array  # (size,): for each state
    # relative velocity in m/s or rad/s below which a contact may be found to have relaxed to rest
    margin: float
    rebound: float  # relative velocity in m/s or rad/s below which stops do not rebound
    velocity_resolution: float  # velocity in m/s or rad/s that the tolerances do not resolve
    force_uncertainty: float  # part of the forces that is uncertain
    speed: float  # velocity scale in m/s or rad/s
    # whether velocities have errors where they pass 0: not of exact engines, or where events are at step ends
    has_errors: bool
    is_guess: bool  # whether nothing but forces told the velocity scale

    def hide(self, reached: Reached) -> bool:
        """Tell whether a run was so slow, beside what forces let expect, that the absolute tolerance hides it."""
        atol = float(self.atol[: reached.velocities.size].max(initial=0.0))
        speed = float(reached.velocities.max(initial=0.0))
        noise = max(_NOISE * max(reached.pushed, self.speed), _SEEN * atol)
        return self.is_guess and noise < speed < atol / _HIDDEN

    def uncertainty(self, fastest: float) -> Uncertainty:
        """Return what is uncertain now: errors of velocities are parts of the `fastest` that the solver has seen."""
        passed = 0.0
        if self.has_errors:
            speed = max(self.speed, fastest)
            passed = _added_up(self.velocity_resolution + self.rtol * (speed - self.speed), speed)
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
    reached: Reached | None = None,
) -> Tolerances:
    """Return tolerances fit for the scene: never looser than asked for.

    The absolute tolerance is tightened to ``rtol V`` where the scene's velocities V are so small that it would hide
    them, and both so that a pre-slip velocity is ``method.resolution`` times what they leave uncertain. V is what an
    earlier run has `reached`, or what velocities at the start, drives and forces let expect.

    Where that is too small for double precision it is refused.
    """
    speed, frequency, is_guess = _speed(system, start, stop)
    if reached is not None:
        speed = float(reached.velocities.max(initial=0.0))
    # the smallest pre-slip velocity
    finest = float(system.laws.resolution[system.alive].min(initial=math.inf))
    resolution = method.resolution
    if speed > 0:
        slow = math.inf if is_exact or method.takes_steps else _slowest_part(system, start, stop)
        if _FINEST * speed < slow < _APART * speed:
            rtol = max(rtol * slow / (_APART * speed), min(rtol, _FINEST))
        noise = 0.0 if reached is None else _ROUNDOFF * reached.pushed
        atol = min(atol, max(rtol * speed, noise))
        if resolution * (rtol * speed + atol) > finest:
            rtol = min(rtol, finest / (2 * resolution * speed))
            atol = min(atol, finest / (2 * resolution))
            if rtol < _FINEST:
                raise _unresolved(system, finest, speed, resolution)
    each = np.full(system.size, atol)
    if speed > 0:
        time = min(stop - start, 1.0 / frequency if frequency else math.inf)
        each[system.n : system.first_bristle] = min(atol, rtol * speed * time)
    for j, state in system.bristle_state.items():
        if system.pressed[j]:
            continue
        force = system.mu_s[:, j].max() * largest_value(system.normals[j], start, stop)
        stiffness = system.laws.characters[j].stiffness or 1.0
        if force > 0:
            each[state] = min(atol, _BRISTLE * force / stiffness)
    if reached is not None:
        each[system.n : system.first_block] = np.minimum(
            each[system.n : system.first_block], rtol * np.concatenate([reached.distances, reached.bristles])
        )
    velocity_resolution = rtol * speed + atol
    force_uncertainty = max(_FORCE_UNCERTAINTY, method.force_uncertainty * rtol)
    relaxed = _added_up(velocity_resolution, speed) if margin is None else margin
    if is_exact:
        # loose tolerances say how soon what dies away counts as at rest, and nothing else
        velocity_resolution = min(velocity_resolution, _EXACT * speed)
    # an exact engine knows velocities to roundoff: so small rebounds are real
    rebound = _REBOUND * speed if is_exact and margin is None else relaxed
    has_errors = not (is_exact or method.takes_steps)
    return Tolerances(
        rtol, each, relaxed, rebound, velocity_resolution, force_uncertainty, speed, has_errors, is_guess
    )


def _added_up(error: float, speed: float) -> float:
    """Return what errors of single steps may add up to in a velocity."""
    return min(_TIMES * error, max(_AT_MOST * speed, error))


def _unresolved(system: System, finest: float, speed: float, resolution: float) -> ValueError:
    names = [row.name for row, v in zip(system.rows, system.laws.resolution, strict=True) if v == finest]
    return ValueError(
        f"contact {names[0]!r}: a pre-slip velocity of {finest:g} is too small beside velocities of {speed:.3g} "
        f"for double precision; make it at least {rounded_up(2 * resolution * _FINEST * speed)}, or use DryFriction"
    )


def _slowest_part(system: System, start: float, stop: float) -> float:
    """Return the velocity scale of the slowest part with contacts, clutches or stops; infinite if there are no parts.

    What the solver leaves uncertain of the fastest part is uncertain of all: a slow contact would not come to rest.
    """
    scene, parts, n = system.scene, system.parts, system.n
    if system.dependence is not None or (parts == parts[0]).all():
        return math.inf
    speed, inertia = np.array([abs(body.velocity) for body in scene.bodies]), system.inertia
    rows = [row.coefficients for row in system.rows]
    led = [largest_value(drive.velocity, start, stop) for drive in scene.drives]
    for ends in (*rows, *(link.coefficients for link in system.couplings)):
        fastest = max((led[i - n] for i in ends if n <= i < n + len(led)), default=0.0)
        for i in ends:
            if i < n:
                speed[i] = max(speed[i], fastest)
    place = [element.position for element in (*scene.bodies, *scene.drives)]
    for link in system.couplings:
        offset = abs(sum(c * place[i] for i, c in link.coefficients.items()) - link.rest)
        for i, c in link.coefficients.items():
            if i < n and inertia[i]:
                speed[i] = max(speed[i], offset * math.sqrt(link.stiffness * abs(c) / inertia[i]))
    for force, signal in zip(scene.forces, system.others[: len(scene.forces)], strict=True):
        i = system.index[force.body]
        if inertia[i] > 0:
            # a function that fails is told of when the run comes to it
            largest = math.inf
            with contextlib.suppress(ValueError):
                largest = largest_value(signal, start, stop)
            speed[i] = max(speed[i], largest / inertia[i] * (stop - start))
    found = np.zeros(parts.max() + 1)
    np.maximum.at(found, parts, speed)
    some = found[np.unique([parts[i] for ends in rows for i in ends if i < n]).astype(np.intp)]
    return float(some[some > 0].min(initial=math.inf))


def _speed(system: System, start: float, stop: float) -> tuple[float, float, bool]:
    """Return the velocity scale, the highest natural frequency (rad/s, 0 without springs), and whether V is a guess."""
    scene = system.scene
    stiffness = np.zeros(system.n + system.drives)
    place = [element.position for element in (*scene.bodies, *scene.drives)]
    stretched = 0.0
    for link in system.couplings:
        offset = sum(c * place[i] for i, c in link.coefficients.items()) - link.rest
        if link.stiffness:
            # the stretch as a displacement of the body with the shortest lever
            stretched = max(stretched, abs(offset) / min(map(abs, link.coefficients.values())))
        for i, c in link.coefficients.items():
            stiffness[i] += link.stiffness * c * c
    for gap, j in zip(scene.gaps, system.is_gap.nonzero()[0].tolist(), strict=True):
        coefficients = system.rows[j].coefficients
        at = sum(c * place[i] for i, c in coefficients.items())
        depth = max(at - gap.upper, gap.lower - at, 0.0)
        stretched = max(stretched, depth / min(map(abs, coefficients.values())))
        for i, c in coefficients.items():
            # where its damping is clipped a gap is as stiff as two
            stiffness[i] += 2 * gap.stiffness * c * c
    heavy = system.inertia > 0
    squared = 2 * stiffness[: system.n][heavy] / system.inertia[heavy]
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
    forces = system.scene.forces
    for force, signal in zip(forces, system.others[: len(forces)], strict=True):
        i = system.index[force.body]
        if system.inertia[i] > 0:
            resistance = max(system.inertia[i] / time, damping[i])
            found = max(found, largest_value(signal, start, stop) / resistance)
    return found


def largest_value(signal: Signal, start: float, stop: float) -> float:
    """Return the largest absolute value at the breaks and at a few times between."""
    times = [*np.linspace(start, stop, 17).tolist(), *signal.breaks(start, stop)]
    return max(abs(signal.at(t)) for t in times)
