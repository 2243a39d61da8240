"""Natural scales of a scene, so that tolerances mean the same whatever the units."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.system import System
from stickslip.model.laws.kernels import BRISTLE, HARD
from stickslip.model.signal_makers import Signal

__all__ = ["Tolerances", "tolerances"]

Array = NDArray[np.float64]

_RESOLVED = 1000.0
"""A pre-slip velocity has to be this many times what the tolerances leave uncertain."""

_FINEST = 1e-13
_BRISTLE = 1e-6


@dataclass(frozen=True)
class Tolerances:
    """What the solver is asked for.

    Attributes
    ----------
    rtol : float
    atol : array (size,)
        For each state.
    margin : float
        Relative velocity in m/s or rad/s below which a contact may be found to have relaxed to rest.
    quiet : float
        Velocity in m/s or rad/s that the tolerances leave uncertain.
    speed : float
        Velocity scale in m/s or rad/s.
    """

    rtol: float
    atol: Array
    margin: float
    quiet: float
    speed: float


def tolerances(
    system: System,
    start: float,
    stop: float,
    rtol: float,
    atol: float,
    margin: float | None,
    method: str,
) -> Tolerances:
    """Return tolerances fit for the scene: never looser than asked for.

    The absolute tolerance is tightened to ``rtol V`` where the scene's velocities V are so small that it would hide
    them, and both so that a pre-slip velocity is a thousand times what they leave uncertain; ten thousand times for
    Adams, which is not made for stiffness.

    Raises
    ------
    ValueError
        If a pre-slip velocity is too small for double precision.
    """
    speed, frequency = _speed(system, start, stop)
    finest = _finest_velocity(system)
    if speed > 0:
        atol = min(atol, rtol * speed)
        resolved = _RESOLVED * (10 if method == "Adams" else 1)
        if resolved * (rtol * speed + atol) > finest:
            rtol = min(rtol, finest / (2 * resolved * speed))
            atol = min(atol, finest / (2 * resolved))
            _refuse_unresolved(system, rtol, finest, speed)
    each = np.full(system.size, atol)
    if frequency > 0 and speed > 0:
        each[system.n : system.first_bristle] = min(atol, rtol * speed / frequency)
    coefficients = system.coefficients
    for j, state in system.bristle_state.items():
        if system.pressed[j]:
            continue
        deflection = coefficients.mu_s[:, j].max() * _largest(system.normals[j], start, stop)
        each[state] = min(atol, _BRISTLE * max(deflection, np.finfo(float).tiny) / coefficients.sigma[j, 0])
    quiet = rtol * speed + atol
    return Tolerances(rtol, each, 100.0 * quiet if margin is None else margin, quiet, speed)


def _refuse_unresolved(system: System, rtol: float, finest: float, speed: float) -> None:
    if rtol >= _FINEST:
        return
    names = [
        row.name for row, v in zip(system.rows, system.coefficients.velocity, strict=True) if v == finest
    ]
    raise ValueError(
        f"contact {names[0]!r}: a pre-slip velocity of {finest:g} is too small beside velocities of {speed:.3g} "
        f"for double precision; make it at least {2 * _RESOLVED * _FINEST * speed:.1g}, or use DryFriction"
    )


def _finest_velocity(system: System) -> float:
    """Return the smallest pre-slip velocity of the scene, infinite without one."""
    c = system.coefficients
    regular = (c.kind != HARD) & (c.kind != BRISTLE) & system.alive
    return float(c.velocity[regular].min(initial=math.inf))


def _speed(system: System, start: float, stop: float) -> tuple[float, float]:
    """Return the velocity scale and the highest natural frequency (rad/s, 0 without springs)."""
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
    heavy = system.inertia > 0
    squared = 2 * stiffness[: system.n][heavy] / system.inertia[heavy]
    frequency = float(np.sqrt(squared.max(initial=0.0)))
    speeds = [abs(body.velocity) for body in scene.bodies]
    speeds += [
        _largest(signal, start, stop) for signal in system.others[len(system.others) - system.drives :]
    ]
    speeds.append(frequency * stretched)
    speed = max(speeds)
    if speed == 0:
        time = min(stop - start, 1.0 / frequency if frequency else math.inf)
        for force, signal in zip(scene.forces, system.others[: system.force_count], strict=True):
            inertia = system.inertia[system.index[force.body]]
            if inertia > 0:
                speed = max(speed, _largest(signal, start, stop) * time / inertia)
    return speed, frequency


def _largest(signal: Signal, start: float, stop: float) -> float:
    """Return the largest absolute value at the breaks and at a few times between."""
    times = [*np.linspace(start, stop, 17).tolist(), *signal.breaks(start, stop)]
    return max(abs(signal(t)) for t in times)
