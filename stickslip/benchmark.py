"""The benchmark of Breedveld (2000, table 1), its extensions, and its published exact event times."""

from __future__ import annotations

from collections.abc import Sequence

from stickslip.model.checks import finite, sequence, whole
from stickslip.model.elements import GROUND, Body, Contact, Damper, Element
from stickslip.model.laws.dry_friction import DryFriction, Law
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.model.signal_makers import triangle
from stickslip.model.signals import Signal
from stickslip.results.outcome import Event

BENCHMARK_SPAN = (0.0, 4.0)  # time span of the benchmark in s

# The friction law of every contact of the benchmark.
FLYWHEEL_LAW = DryFriction(mu_static=0.2, mu_coulomb=0.1, dwell=0.1)

# The events of `flywheel_benchmark`, published reference values from 40-digit arithmetic.
EXACT_EVENTS = (
    Event(0.000909090909090909, "interface", Mode.BACKWARD, Mode.STUCK, "exact"),
    Event(0.473006762576147516, "interface", Mode.STUCK, Mode.BACKWARD, "exact"),
    Event(0.527593338990130857, "brake", Mode.FORWARD, Mode.STUCK, "exact"),
    Event(0.575899715052702889, "brake", Mode.STUCK, Mode.FORWARD, "exact"),
    Event(0.653395901643388061, "interface", Mode.BACKWARD, Mode.STUCK, "exact"),
)

# The velocity in rad/s of both wheels of `flywheel_benchmark` after the last event, to the same digits.
EXACT_FINAL_VELOCITY = 0.687838305725714362


def flywheel_benchmark(law: Law = FLYWHEEL_LAW) -> Scene:
    """Return two flywheels with a friction contact between them and a brake that acts twice on the first.

    Parameters
    ----------
    law : Law
        Friction law of both contacts, with coefficients in m (unit arm).
    """
    brake = triangle(0.05, 0.10, 0.15, slope=3000.0) + triangle(0.4, 0.5, 0.6, slope=3000.0)
    return Scene(
        Body("wheel1", inertia=1.0, velocity=1.0),
        Body("wheel2", inertia=10.0, velocity=1.01),
        Contact("interface", "wheel1", "wheel2", law, normal=100.0),
        Contact("brake", "wheel1", GROUND, law, normal=brake),
    )


def four_flywheels(viscous: float = 0.0, law: Law = FLYWHEEL_LAW) -> Scene:
    """Return four flywheels in a row, braked once (Breedveld 2000, figs. 9 to 12).

    Parameters
    ----------
    viscous : float
        Damping between neighbours in N m s/rad; 0 leaves the dampers out.
    law : Law
        Friction law of all contacts, with coefficients in m (unit arm).

    Raises
    ------
    ValueError, TypeError
        If the damping is negative or not a number.
    """
    return flywheel_chain(
        4,
        inertias=(1.0, 2.0, 3.0, 4.0),
        velocities=(1.0, 1.01, 1.02, 1.03),
        normals=(100.0, 60.0, 30.0),
        viscous=viscous,
        law=law,
    )


def flywheel_chain(
    n: int,
    *,
    inertias: Sequence[float] | None = None,
    velocities: Sequence[float] | None = None,
    normals: Sequence[float] | None = None,
    viscous: float = 0.0,
    brake: Signal | float | None = None,
    law: Law = FLYWHEEL_LAW,
) -> Scene:
    """Return `n` flywheels in a row with friction contacts between neighbours and a brake on the first.

    Bodies are called w1, w2, ...; contacts c12, c23, ... (c1-2, c2-3, ... from ten wheels on) and brake.

    Parameters
    ----------
    n : int
        Number of wheels, at least 1.
    inertias : sequence of n floats, optional
        In kg m^2; 1 each where left out.
    velocities : sequence of n floats, optional
        At the start, in rad/s; 1, 1.01, 1.02, ... where left out.
    normals : sequence of n - 1 floats, optional
        Normal forces between neighbours in N; falling evenly from 100 towards 0 where left out.
    viscous : float
        Damping between neighbours in N m s/rad; 0 leaves the dampers out.
    brake : float or Signal, optional
        Normal force of the brake in N; where left out, the triangle 0.4, 0.5, 0.6 s of slope 3000 N/s.
    law : Law
        Friction law of all contacts, with coefficients in m (unit arm).

    Raises
    ------
    ValueError, TypeError
        If `n` is below 1, a sequence has another length, or a number is out of its range.
    """
    n, viscous = whole(n, "flywheel_chain: n", 1), finite(viscous, "flywheel_chain: viscous")
    inertias = _numbers("inertias", inertias, [1.0] * n)
    velocities = _numbers("velocities", velocities, [1.0 + 0.01 * i for i in range(n)])
    normals = _numbers("normals", normals, [100.0 * (n - i) / n for i in range(1, n)])
    between = "" if n < 10 else "-"
    elements: list[Element] = [
        Body(f"w{i}", inertia=inertia, velocity=velocity)
        for i, (inertia, velocity) in enumerate(zip(inertias, velocities, strict=True), 1)
    ]
    for i, normal in enumerate(normals, 1):
        elements.append(Contact(f"c{i}{between}{i + 1}", f"w{i}", f"w{i + 1}", law, normal=normal))
        if viscous:
            elements.append(Damper(f"w{i}", f"w{i + 1}", damping=viscous))
    pulse = triangle(0.4, 0.5, 0.6, slope=3000.0) if brake is None else brake
    return Scene(*elements, Contact("brake", "w1", GROUND, law, normal=pulse))


def _numbers(name: str, given: Sequence[float] | None, default: list[float]) -> Sequence[float]:
    if given is None:
        return default
    found = sequence(given, f"flywheel_chain: {name}")
    if len(found) != len(default):
        raise ValueError(f"flywheel_chain: {name} must have {len(default)} entries, got {len(found)}")
    return found
