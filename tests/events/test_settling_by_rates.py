"""Where forces and levels are 0, their rates decide; each side of an anisotropic law on its own."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from reading import told

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Scene,
    piecewise_linear,
    simulate,
    sine,
)

FORMULATIONS = ("contact-force", "merged", "multiplier")
FREEWHEEL = DryFriction(0.0, 0.0, mu_static_backward=0.6, mu_coulomb_backward=0.5)


# Contacts that close together

# Mass, slope of the force from t = 1 s on; then other end, static and Coulomb coefficients forward and
# backward, slope of the normal force. The modes and velocities after t = 1 s are those of rule 3 of the model
# with rates in place of forces (least squares by hand); motion from rest under forces that rise as t - 1 ends
# at t = 2 s with v = a' / 2.
CLOSING = {
    "one holds": (
        [2.57, 1.21, 1.74, 1.59],
        [-5.1, 6.0, -2.8, -11.6],
        [
            (-1, 0.143, 0.11, 1.02, 0.17, 9.2),
            (-1, 0.364, 0.28, 0.25, 0.25, 3.7),
            (1, 0.702, 0.54, 0.38, 0.38, 4.6),
            (0, 0.715, 0.55, 0.66, 0.22, 7.6),
        ],
        [0, 1, -1, -1],
    ),
    "the last holds": (
        [1.63, 0.73, 0.38, 1.24],
        [-11.6, -4.9, -11.4, 1.7],
        [
            (-1, 0.338, 0.26, 0.17, 0.17, 7.9),
            (0, 0.728, 0.56, 1.38, 0.46, 5.0),
            (-1, 0.572, 0.44, 0.45, 0.15, 8.1),
            (1, 0.611, 0.47, 0.48, 0.16, 9.5),
        ],
        [-1, 1, -1, 0],
    ),
    "it slips forward": (
        [1.9, 0.81, 1.53],
        [2.3, -3.8, 4.5],
        [
            (-1, 0.468, 0.36, 3.0, 0.5, 9.7),
            (0, 0.533, 0.41, 0.12, 0.12, 4.7),
            (0, 0.39, 0.3, 1.86, 0.31, 8.5),
        ],
        [1, -1, 0],
    ),
}


def jerks(case: str) -> np.ndarray:
    """Return the bodies' rates of acceleration just after t = 1 s in the right modes."""
    masses, slopes, contacts, modes = CLOSING[case]
    incidence = np.zeros((len(contacts), len(masses)))
    force = np.array(slopes)
    for j, (other, _, forward, _, backward, normal) in enumerate(contacts):
        incidence[j, j] = 1
        if other >= 0:
            incidence[j, other] = -1
        if modes[j]:
            force -= incidence[j] * modes[j] * (forward if modes[j] > 0 else backward) * normal
    held = incidence[[j for j, mode in enumerate(modes) if mode == 0]]
    gram = held / masses @ held.T
    return (force - held.T @ np.linalg.solve(gram, held / masses @ force)) / masses


def closing(case: str, tiny: float) -> Scene:
    masses, slopes, contacts, _ = CLOSING[case]
    elements: list[Body | Contact | Force] = [Body(f"b{i}", inertia=m) for i, m in enumerate(masses)]
    for j, (other, *mu, normal) in enumerate(contacts):
        law = DryFriction(mu[0], mu[1], mu_static_backward=mu[2], mu_coulomb_backward=mu[3])
        end = GROUND if other < 0 else f"b{other}"
        elements.append(Contact(f"c{j}", f"b{j}", end, law, normal=piecewise_linear([1, 2], [0, normal])))
        elements.append(Force(f"b{j}", piecewise_linear([1, 2, 2.5], [0, slopes[j], 0])))
    return Scene(*elements, Force("b0", sine(tiny, 1.0))) if tiny else Scene(*elements)


@pytest.mark.parametrize("tiny", [0.0, 1e-25])
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("case", CLOSING)
def test_contacts_that_close_together(case: str, formulation: str, tiny: float) -> None:
    result = simulate(closing(case, tiny), (0.0, 3.0), formulation=formulation, t_eval=[1.0, 1.001, 2.0])
    modes = CLOSING[case][3]
    assert [int(result.mode(f"c{j}")[1]) for j in range(len(modes))] == modes
    found = [float(result.velocity(f"b{i}")[2]) for i in range(len(modes))]
    # the multiplier formulation may start with rates that differ by what the modes decide only
    assert found == pytest.approx((0.5 * jerks(case)).tolist(), abs=1e-7)


# A freewheel written as an anisotropic law


@pytest.mark.parametrize("method", ["BDF", "Adams"])
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_freewheel_under_a_sine(formulation: str, method: str) -> None:
    """Stuck while the force is backward, up to 2 s; then v = (3/w) (1 - cos w (t - 2)) with w = pi/2."""
    if (formulation, method) == ("multiplier", "Adams"):
        pytest.skip("IDA is a BDF method")
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("c", "b", GROUND, FREEWHEEL, normal=10.0),
        Force("b", sine(3.0, 0.25, math.pi)),
    )
    result = simulate(scene, (0.0, 5.0), formulation=formulation, method=method, t_eval=[1.0, 3.0, 5.0])
    assert told(result) == [("c", 0, 1)]
    assert result.events[0].t == pytest.approx(2.0, abs=1e-9)
    assert result.velocity("b").tolist() == pytest.approx([0.0, 6 / math.pi, 6 / math.pi], abs=1e-6)
    assert result.force("c").tolist() == pytest.approx([-3.0, 0.0, 0.0], abs=1e-6)


def stepped(amplitude: float, frequency: float, phase: float, stop: float) -> float:
    """Return the velocity at `stop`, by steps of 5e-5 s and the law of the freewheel as a projection."""
    h = 5e-5
    t = (np.arange(round(stop / h)) + 0.5) * h
    v = 0.0
    for push in (h * amplitude * np.sin(2 * np.pi * frequency * t + phase)).tolist():
        ahead = v + push
        # the body runs forward freely; backward the contact holds 6 N and slips at 5 N
        if ahead >= 0:
            v = ahead
        elif v >= 0 and ahead > -6.0 * h:
            v = 0.0
        else:
            v = min(0.0, ahead + 5.0 * h)
    return v


@pytest.mark.parametrize("number", range(6))
def test_freewheels_under_random_sines(number: int) -> None:
    draw = random.Random(number)
    load = draw.uniform(1, 5), draw.uniform(0.2, 1), draw.uniform(0, 6)
    scene = Scene(Body("b", inertia=1.0), Contact("c", "b", GROUND, FREEWHEEL, normal=10.0), Force("b", sine(*load)))
    wanted = stepped(*load, 5.0)
    for formulation in FORMULATIONS:
        result = simulate(scene, (0.0, 5.0), formulation=formulation, t_eval=[5.0])
        assert result.velocity("b")[0] == pytest.approx(wanted, abs=1e-3)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("velocity", [5.0, 9.0, 10.0, 12.0])
def test_friction_one_way_only(velocity: float, formulation: str) -> None:
    """Coefficients 1 forward and 0 backward, 10 N, load 50 sin 2 pi t on 1 kg: against steps of 1e-4 s."""
    law = DryFriction(1.0, 1.0, mu_static_backward=0.0, mu_coulomb_backward=0.0)
    scene = Scene(
        Body("b", inertia=1.0, velocity=velocity),
        Contact("c", "b", GROUND, law, normal=10.0),
        Force("b", sine(50.0, 1.0)),
    )
    result = simulate(scene, (0.0, 3.0), formulation=formulation, t_eval=[0.9, 1.3, 2.0, 3.0])
    h, v, wanted = 1e-4, velocity, []
    for k in range(30000):
        if k in (9000, 13000, 20000):
            wanted.append(v)
        ahead = v + h * 50.0 * math.sin(2 * math.pi * (k + 0.5) * h)
        v = ahead if ahead < 0 else max(0.0, ahead - 10.0 * h)
    assert result.velocity("b").tolist() == pytest.approx([*wanted, v], abs=5e-3)


# A contact with friction in motion only is not frictionless


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_drag_alone(formulation: str) -> None:
    """m v' = F - 0.4 v^2 with m = 2: v = 5 tanh (t - 0.1) for F = 10 from 0.1 s on, and 20 / (1 + 4 t) for F = 0."""
    drag = DryFriction(0.0, 0.0, kinetic=lambda v: v * v)
    contact = Contact("drag", "car", GROUND, drag, normal=0.4)
    pushed = Scene(Body("car", inertia=2.0), contact, Force("car", piecewise_linear([0.1, 0.1], [0.0, 10.0])))
    options = {"formulation": formulation, "rtol": 1e-10, "atol": 1e-12}
    result = simulate(pushed, (0.0, 5.0), t_eval=[5.0], **options)  # type: ignore[arg-type]
    assert result.velocity("car")[0] == pytest.approx(5 * math.tanh(4.9), rel=1e-8)
    assert result.force("drag")[0] == pytest.approx(10 * math.tanh(4.9) ** 2, rel=1e-8)
    free = Scene(Body("car", inertia=2.0, velocity=20.0), contact)
    coasted = simulate(free, (0.0, 5.0), t_eval=[5.0], **options)  # type: ignore[arg-type]
    assert coasted.velocity("car")[0] == pytest.approx(20 / 21, rel=1e-8)
