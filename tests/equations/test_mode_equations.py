"""The maps of a scene are the same, dense, sparse and put together, or sparse and applied one by one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    LuGre,
    Scene,
    Spring,
    Tie,
    position,
    sine,
)
from stickslip.equations import system as systems
from stickslip.equations.algebra.matrices import dense
from stickslip.equations.mode_equations import FREE, OPEN, equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.simulation.simulate import compiled

CURVED = DryFriction(0.4, 0.3, stribeck_velocity=0.2, dwell=0.5)


def machine(count: int, on_the_ground: bool) -> Scene:
    """Return bodies in a row that rub on the ground or on each other, with all kinds of parts between them."""
    names = [f"b{i}" for i in range(count)]
    return Scene(
        *(Body(name, inertia=1.0 + 0.1 * (i * 5 % 12), velocity=0.3 - 0.1 * i) for i, name in enumerate(names)),
        Drive("belt", velocity=0.2 + sine(0.1, 0.5)),
        *(
            Contact(f"c{i}", name, GROUND if on_the_ground else [*names, "belt"][i + 1], CURVED, normal=3.0 + i)
            for i, name in enumerate(names)
        ),
        Contact("brush", "b1", "belt", LuGre(DryFriction(0.4, 0.3), stiffness=100.0, damping=2.0), normal=2.0),
        Contact("fed", "b2", "belt", DryFriction(0.2, 0.1), normal=4.0 + 0.5 * position("b3")),
        Tie("gear", {"b4": 1.0, "b5": -2.0}),
        Gap("stop", "b0", GROUND, upper=0.1, stiffness=50.0, damping=1.0),
        *(Spring(a, b, stiffness=4.0, damping=0.1) for a, b in pairwise(names)),
        Damper("b3", "belt", damping=0.5),
        Force("b2", sine(2.0, 0.7)),
    )


def motion_in(scene: Scene, modes: dict[str, int]) -> Motion:
    system = compiled(scene)
    assert isinstance(system, System)
    given = np.array([modes.get(row.name, 0 if row.name == "gear" else 1) for row in system.rows], dtype=np.int8)
    given[system.is_gap] = OPEN
    equations = equations_in(given, system, np.zeros(system.piecewise.count, dtype=np.int16))
    loads = system.loads(0.0, 4.0, False)
    return Motion(equations, loads.after(0.3), 0.3, system.at_start(), np.zeros(system.m))


@pytest.mark.parametrize(
    ("on_the_ground", "held", "is_together"),
    [
        (True, range(0), True),
        (True, range(0, 12, 2), True),
        (False, range(3), True),
        (False, (0, 1, 2, 3, 5, 6, 7, 8, 9, 10), False),
    ],
    ids=["all slip", "half sticks to the ground", "three stick together", "all stick together"],
)
def test_sparse_is_dense(
    monkeypatch: pytest.MonkeyPatch, on_the_ground: bool, held: Sequence[int], is_together: bool
) -> None:
    modes = {f"c{i}": 0 for i in held} | {"brush": FREE}
    one = motion_in(machine(12, on_the_ground), modes)
    monkeypatch.setattr(systems, "_DENSE_LIMIT", 0)
    other = motion_in(machine(12, on_the_ground), modes)
    assert other.system.sparse and not one.system.sparse
    assert other.equations.is_assembled is is_together
    random = np.random.default_rng(3)
    y = random.normal(size=(one.y.size, 5))
    q = random.normal(size=(one.start_inputs.size, 5))
    e = random.normal(size=(one.equations.velocity_dependent.size, 5))
    for name, columns in (("apply", y), ("watch", y), ("respond", q), ("push", e)):
        expected = getattr(one.equations, name)(columns)
        scale = np.abs(expected).max()
        for given, known in ((columns, expected), (columns[:, 2], expected[:, 2])):
            found = getattr(other.equations, name)(given)
            np.testing.assert_allclose(found, known, rtol=0, atol=1e-13 * scale, err_msg=name)
    for tau in (0.0, 0.4):
        state = one.exact(tau, y[:, 0].copy())
        n = one.system.n
        for found, known in (
            (one.rate_beside_velocities(tau, state), one.rate(tau, state)[n:]),
            (other.rate_beside_velocities(tau, state, one.inputs(tau, state)), one.rate(tau, state)[n:]),
            (other.rate(tau, state), one.rate(tau, state)),
            (other.watched(tau, state), one.watched(tau, state)),
            (dense(other.jacobian(tau, state)), one.jacobian(tau, state)),
        ):
            np.testing.assert_allclose(found, known, rtol=0, atol=1e-12 * np.abs(known).max())
    of_states = [each.equations.guard_rows(np.ones(each.system.m)).of_states(y) for each in (other, one)]
    np.testing.assert_allclose(*of_states, rtol=0, atol=1e-12 * np.abs(of_states[1]).max())
