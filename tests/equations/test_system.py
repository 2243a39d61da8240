"""A scene as constants."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene
from stickslip.equations import system
from stickslip.equations.system import System
from stickslip.simulation.simulate import compiled


def test_free_mobility_of_rows() -> None:
    """A force of 1 N between two bodies moves them apart by 1 / m_a + 1 / m_b; levers count twice."""
    scene = Scene(
        Body("a", inertia=2.0),
        Body("b", inertia=4.0),
        Contact("c", "a", "b", DryFriction(0.1, 0.1), normal=1.0),
        Contact("d", "a", GROUND, DryFriction(0.1, 0.1), normal=1.0, radius_a=3.0),
    )
    assert compiled(scene).free_mobility == pytest.approx([0.75, 4.5])


@pytest.mark.parametrize("seed", range(6))
def test_what_drives_tear_is_found_among_the_rows_that_are_joined(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """Drives tear held rows where these leave them no velocities of their own: a large scene looks at a part of them.

    ``y G = 0`` with ``y D`` not 0 for some forces y of the rows. Also where that part is a long row of bodies.
    """
    rng, law, count = np.random.default_rng(seed), DryFriction(0.2, 0.1), 80
    ends = [GROUND, "belt", "table"]
    links = [(f"b{i}", f"b{i + 1}") for i in range(count - 1)]
    links += [(f"b{i}", ends[rng.integers(3)]) for i in rng.choice(count, 6, replace=False)]
    scene = Scene(
        Drive("belt", velocity=1.0),
        Drive("table", velocity=2.0),
        *(Body(f"b{i}", inertia=1.0) for i in range(count)),
        *(Contact(f"c{i}", a, b, law, normal=1.0) for i, (a, b) in enumerate(links)),
    )
    dense = System(scene)
    monkeypatch.setattr(system, "_DENSE_LIMIT", 4)
    large = System(scene)
    answers = []
    for part in np.repeat([0.7, 0.99, 1.0], 4):
        held = rng.random(dense.m) < part
        row = int(rng.integers(count - 1, dense.m))
        held[row] = False
        if dense.balance(held).parting is not None:
            # leave what is joined to one end only
            held[count - 1 :] = False
            held[int(rng.integers(count - 1, dense.m))] = True
            held[row] = False
        with_row = held.copy()
        with_row[row] = True
        G, D = dense.G[with_row], dense.D[with_row]
        rank = np.linalg.matrix_rank(G)
        told = bool(np.linalg.matrix_rank(np.hstack([G, D])) > rank)
        assert large.is_torn_with(held, row) == dense.is_torn_with(held, row) == told
        answers.append(told)
    assert 0 < sum(answers) < len(answers)
