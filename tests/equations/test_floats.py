"""Small motions in plain floats give what arrays give, and bounds of guards hold over whole steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    LuGre,
    PreSlip,
    Scene,
    Spring,
    feedback,
    output,
    position,
    power,
    signal,
    sine,
    table,
    triangle,
    velocity,
)
from stickslip.engines.solvers.guards_along import GuardsAlong
from stickslip.equations.guards.guards import Guards
from stickslip.equations.mode_equations import FREE, equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes, from_nodes
from stickslip.equations.system import System
from stickslip.model.elements import Element
from stickslip.model.laws.dry_friction import Law

CURVES = {
    "a function": DryFriction(0.5, 0.3, kinetic=lambda v: 0.2 + 0.3 / (1 + 3 * v)),
    "Stribeck": DryFriction(0.5, 0.3, stribeck_velocity=0.1),
    "Stribeck, vertical at rest": DryFriction(0.5, 0.3, stribeck_velocity=0.1, stribeck_exponent=0.5),
    "two sides": DryFriction(0.5, 0.3, stribeck_velocity=0.1, mu_static_backward=0.6, mu_coulomb_backward=0.2),
    "Coulomb": DryFriction(0.5, 0.3, dwell=0.1),
}


def started(law: DryFriction, modes: tuple[int, int], uncertain: float | None = None) -> tuple[Motion, Guards]:
    """Two bodies in a row, the first one on a belt, the second one on a spring."""
    scene = Scene(
        Drive("belt", velocity=0.2),
        Body("a", inertia=1.0, velocity=0.5),
        Body("b", inertia=2.0, velocity=0.4 if modes[1] else 0.5),
        Contact("on belt", "a", "belt", law, normal=10.0 + triangle(0.0, 0.1, 0.3, slope=100.0)),
        Contact("between", "a", "b", law, normal=5.0),
        Spring("b", GROUND, stiffness=3.0, damping=0.1),
    )
    system = System(scene)
    numbers = np.array(modes, dtype=np.int8)
    stretch, since = system.loads(0.0, 1.0).after(0.0), np.zeros(system.m)
    motion = Motion(equations_in(numbers, system), stretch, 0.0, system.at_start(), since)
    none = np.zeros(2, dtype=bool)
    return motion, Guards(motion, numbers, numbers == 0, none, None if uncertain is None else np.full(2, uncertain))


@pytest.mark.parametrize("law", CURVES.values(), ids=CURVES)
@pytest.mark.parametrize("modes", [(1, 1), (1, -1), (-1, 1), (1, 0)])
def test_rates_and_guards_in_floats_are_those_in_arrays(law: DryFriction, modes: tuple[int, int]) -> None:
    motion, guards = started(law, modes, uncertain=1e-9)
    assert motion.in_floats is not None
    random = np.random.default_rng(1)
    for tau in random.uniform(0.0, 0.1, 20).tolist():
        y = random.normal(size=motion.y.size)
        found = np.empty(y.size)
        motion.in_floats(tau, y, found)
        np.testing.assert_allclose(found, motion.rate(tau, y), rtol=1e-13, atol=1e-13)
        assert guards.in_floats is not None
        low = guards.values(tau, y, with_leeway=True).min()
        assert guards.in_floats(tau, y) == pytest.approx(low, rel=1e-12, abs=1e-12)


def swinging(t: float) -> float:
    return math.sin(3 * t) / (2 + math.cos(t))


CURVE = CURVES["Stribeck"]
HEATED = Block(
    "heat",
    inputs=[power("on belt"), velocity("b")],
    states=[0.3, 0.1],
    derivative=lambda t, x, u: [u[0] - x[0], x[0] * u[1] * math.cos(t)],
)
MOVED: dict[str, tuple[Law, list[Element]]] = {
    "a sine": (CURVE, [Force("a", sine(2.0, 1.3, phase=0.4) + 0.1)]),
    "two sines and a ramp": (
        CURVE,
        [Force("a", sine(2.0, 1.3) + sine(1.0, 0.2)), Force("b", triangle(0.0, 0.5, 2.0, slope=3.0))],
    ),
    "a function of time": (CURVE, [Force("b", signal(swinging))]),
    "a pressing sine": (CURVE, [Contact("more", "b", GROUND, CURVE, normal=5.0 + sine(2.0, 0.7))]),
    "a drive that turns": (CURVE, [Drive("arm", velocity=sine(0.4, 0.9)), Spring("b", "arm", stiffness=2.0)]),
    "functions of the state": (
        DryFriction(0.5, 0.3),
        [
            Force("a", feedback(lambda x, v: -(x**3) * v, position("b"), velocity("a"))),
            Force("b", feedback(math.sin, feedback(math.cos, velocity("b")) + sine(1.0, 0.3))),
        ],
    ),
    "tables": (CURVE, [Force("a", table(velocity("a"), [-1.0, 0.0, 2.0], [1.0, 0.0, -3.0]))]),
    "pressed by the state": (
        CURVE,
        [Contact("more", "b", GROUND, CURVE, normal=5.0 + 0.1 * position("a") - velocity("b"))],
    ),
    "a block of functions": (CURVE, [HEATED, Force("b", output("heat") + output("heat", 1))]),
    "heat of Coulomb friction": (DryFriction(0.5, 0.3), [HEATED, Force("b", output("heat"))]),
    "tanh": (PreSlip(CURVES["two sides"], 0.1, "tanh"), []),
    "arctan": (PreSlip(CURVES["two sides"], 0.1, "arctan"), [Force("a", sine(2.0, 1.3))]),
    "linear pre-slip": (PreSlip(CURVES["two sides"], 0.1), []),
    "bristles": (LuGre(CURVES["two sides"], 100.0, 2.0, 0.1), [Force("a", sine(2.0, 1.3))]),
    "a level that rises": (DryFriction(0.5, 0.3, dwell=0.2), [Force("a", sine(2.0, 1.3))]),
}


def moved(law: Law, more: list[Element], mode: int, t: float = 0.0) -> tuple[Motion, Guards]:
    """The first body on a belt in a mode, on a spring to the second, with more that moves them, from `t` on."""
    scene = Scene(
        Drive("belt", velocity=0.2),
        Body("a", inertia=1.0, velocity=0.5 if mode else 0.2),
        Body("b", inertia=2.0, velocity=0.4),
        Contact("on belt", "a", "belt", law, normal=10.0),
        Spring("b", "a", stiffness=3.0, damping=0.1),
        *more,
    )
    system = System(scene)
    own = FREE if system.laws.has_state[0] else mode
    numbers = np.array([own, *[1] * (system.m - 1)], dtype=np.int8)
    loads = system.loads(0.0, 10.0)
    if system.dependence is not None and system.dependence.tables:
        loads.table_regions = (2,) * len(system.dependence.tables)
    equations, since = equations_in(numbers, system), np.zeros(system.m)
    motion = Motion(equations, loads.after(t), t, system.at_start(), since)
    return motion, Guards(motion, numbers, numbers == 0, np.zeros(system.m, dtype=bool), np.full(system.m, 1e-9))


@pytest.mark.parametrize("law, more", MOVED.values(), ids=MOVED)
@pytest.mark.parametrize("mode", [1, -1, 0])
def test_whatever_moves_it(law: Law, more: list[Element], mode: int) -> None:
    for t in (0.0, 7.3):
        motion, guards = moved(law, more, mode, t)
        assert motion.in_floats is not None
        random = np.random.default_rng(1)
        for tau in random.uniform(0.0, 0.1, 20).tolist():
            y = motion.exact(tau, random.normal(size=motion.y.size))
            found = np.empty(y.size)
            motion.in_floats(tau, y, found)
            np.testing.assert_allclose(found, motion.rate(tau, y), rtol=1e-12, atol=1e-12)
            if motion.table_regions:
                assert motion.has_left_in_floats is not None
                assert motion.has_left_in_floats(tau, y) == motion.has_left(tau, y)
            if guards.size:
                assert guards.in_floats is not None
                low = guards.values(tau, y, with_leeway=True).min()
                assert guards.in_floats(tau, y) == pytest.approx(low, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("law", CURVES.values(), ids=CURVES)
@pytest.mark.parametrize("modes", [(1, 1), (-1, 1), (1, 0), (0, 0)])
def test_no_guard_goes_below_its_bound(law: DryFriction, modes: tuple[int, int]) -> None:
    motion, guards = started(law, modes)
    random, steps, order = np.random.default_rng(2), 5, 5
    taus = np.append(0.0, np.sort(random.uniform(0.0, 0.1, steps)))
    values = motion.y + random.normal(scale=0.1, size=(steps, order + 1, motion.y.size))
    path = Path(taus, from_nodes(order) @ values, values[-1, -1], False, True)
    low = guards.along(path)[2]
    s = np.linspace(0.0, 1.0, 50)[:-1]
    for k in range(steps):
        at = taus[k] + s * (taus[k + 1] - taus[k])
        there = guards.raw(motion.watched(at, states := motion.exact(at, path.at(at).T)), motion.inputs(at, states))
        known = low[:, k] > -math.inf
        stays = guards.order == np.iinfo(np.intp).max
        some = known & ~stays
        assert np.all(there[some].min(axis=1) >= low[some, k] - 1e-12)
    # bounds of velocities are always known, those of forces where no curve acts on them
    assert np.all(low[guards.is_velocity] > -math.inf)
    assert np.isinf(low).any() == (modes == (1, 0) and law.curved)


@pytest.mark.parametrize("case", ["tables", "pressed by the state"])
@pytest.mark.parametrize("mode", [1, 0])
def test_guards_are_polynomials_where_inputs_are_linear_in_the_state(case: str, mode: int) -> None:
    motion, guards = moved(*MOVED[case], mode)
    random, order = np.random.default_rng(3), 5
    taus = np.array([0.0, 0.03, 0.1])
    points = random.normal(size=(2, order + 1, motion.y.size))
    path = Path(taus, from_nodes(order) @ points, points[-1, -1], False, True)
    along = GuardsAlong(motion, guards, path)
    rows = along.are_exact.nonzero()[0]
    assert guards.is_normal.any() == (case == "pressed by the state")
    assert along.are_exact[guards.is_normal | guards.is_velocity].all()
    at = random.uniform(1e-3, 0.1, 20)
    values = guards.undivided(at, motion.exact(at, path.at(at).T))
    np.testing.assert_allclose(along.values(rows, at), values[rows], rtol=1e-11, atol=1e-11)


def test_a_bound_is_sharp_where_a_guard_hardly_changes() -> None:
    motion, guards = started(CURVES["Coulomb"], (1, 1))
    nodes = chebyshev_nodes(5)
    path = Path(np.array([0.0, 0.1]), from_nodes(5) @ (motion.y + 0 * nodes[:, None])[None], motion.y, False, True)
    np.testing.assert_allclose(guards.along(path)[2][:, 0], [0.3, 0.1], rtol=1e-13)
