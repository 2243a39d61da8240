"""Forces of least norm within all limits, by least distances: against bounded least squares."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, piecewise_linear
from stickslip.equations.guards.guards import Guards
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.events.sharing import Share, share

Ends = list[tuple[int, int]]


def shared(ends: Ends, levels: Any, pushes: np.ndarray, radii: Any = None) -> Share | None:
    """How contacts of `levels` share what `pushes` on bodies need, all of them stuck; -1 is the ground."""
    radii = np.ones(len(ends)) if radii is None else radii
    law = DryFriction(1.0, 0.5)
    system = System(
        Scene(
            *(Body(f"b{i}", inertia=float(i + 1)) for i in range(pushes.size)),
            *(
                Contact(f"c{j}", f"b{a}", GROUND if b < 0 else f"b{b}", law, normal=level, radius_a=float(radius))
                for j, ((a, b), level, radius) in enumerate(zip(ends, levels, radii, strict=True))
            ),
            *(Force(f"b{i}", float(push)) for i, push in enumerate(pushes)),
        )
    )
    modes = np.zeros(system.m, dtype=np.int8)
    loads = system.loads(0.0, 1.0)
    motion = Motion(equations_in(modes, system), loads.after(0.0), 0.0, np.zeros(system.size), np.zeros(system.m))
    none = np.zeros(system.m, dtype=bool)
    return share(motion, Guards(motion, modes, none, none), np.ones(modes.size, dtype=bool))


def network(seed: int) -> tuple[Ends, np.ndarray, np.ndarray, np.ndarray]:
    """Bodies that all hang on the ground, with up to five contacts more than they need."""
    draw = np.random.default_rng([seed, 11])
    count = int(draw.integers(1, 6))
    ends = [(i, -1 if i == 0 else int(draw.integers(-1, i))) for i in range(count)]
    for _ in range(int(draw.integers(1, 6))):
        a, b = int(draw.integers(count)), int(draw.integers(-1, count))
        ends.append((a, b if b != a else -1))
    rows = np.zeros((len(ends), count))
    for j, (a, b) in enumerate(ends):
        rows[j, a] = 1.0
        if b >= 0:
            rows[j, b] = -1.0
    levels = draw.uniform(0.5, 10.0, len(ends)).round(2)
    return ends, rows, levels, draw.uniform(-9.0, 9.0, count).round(2)


def test_one_body_on_two_contacts() -> None:
    # 3 N between levels of 10 N and 1 N: 1.5 N each is too much for the second, which carries 1 N
    found = shared([(0, -1), (0, -1)], np.array([10.0, 1.0]), np.array([3.0]))
    assert found is not None and found.holds
    assert (found.rows.tolist(), found.side.tolist()) == ([1], [1.0])
    # of 1.5 N each carries half, below both levels; 12 N are more than both levels together
    found = shared([(0, -1), (0, -1)], np.array([10.0, 1.0]), np.array([1.5]))
    assert found is not None and found.holds and not found.rows.size
    found = shared([(0, -1), (0, -1)], np.array([10.0, 1.0]), np.array([-12.0]))
    assert found is not None and not found.holds
    assert (sorted(found.rows.tolist()), found.side.tolist()) == ([0, 1], [-1.0, -1.0])


@pytest.mark.parametrize(("later", "limiting"), [(1.9, 2), (2.1, 1)])
def test_what_is_at_two_limits_at_once_is_decided_by_their_rates(later: float, limiting: int) -> None:
    # 8 N on a body; its neighbour takes 8/3 N of it, but the joint carries 2 N, as the neighbour's floor does now
    floor = piecewise_linear([0.0, 1.0], [2.0, later])
    found = shared([(0, -1), (0, 1), (1, -1)], [20.0, 2.0, floor], np.array([8.0, 0.0]))
    assert found is not None and found.holds
    assert (found.rows.tolist(), found.side.tolist()) == ([limiting], [1.0])


def test_forces_of_unequal_radii_are_compared_at_the_body() -> None:
    # 8 N m on radii 1, 1, 2 m: 8/3 N m each; the first takes 1 N m only, the others 3.5 N m: 3.5 N and 1.75 N
    ends = [(0, -1)] * 3
    found = shared(ends, [1.0, 100.0, 1.8], np.array([8.0]), radii=[1.0, 1.0, 2.0])
    assert found is not None and found.rows.tolist() == [0]
    found = shared(ends, [1.0, 3.4, 100.0], np.array([8.0]), radii=[1.0, 1.0, 2.0])
    assert found is not None and found.rows.tolist() == [0, 1]


def test_nothing_is_shared_in_a_tree() -> None:
    assert shared([(0, -1), (1, 0)], np.array([1.0, 1.0]), np.array([3.0, 2.0])) is None


@pytest.mark.parametrize("seed", range(60))
def test_networks_share_as_bounded_least_squares_says(seed: int) -> None:
    ends, rows, levels, pushes = network(seed)
    found = shared(ends, levels, pushes)
    # a small weight on the norm leaves the balance exact to 1e-9
    wanted = lsq_linear(
        np.vstack([rows.T, 1e-5 * np.eye(len(ends))]),
        np.concatenate([pushes, np.zeros(len(ends))]),
        (-levels, levels),
        method="bvls",
        tol=1e-14,
    ).x
    holds = float(np.abs(rows.T @ wanted - pushes).max()) < 1e-6
    loops = [j for j in range(len(ends)) if np.linalg.matrix_rank(np.delete(rows, j, 0)) == len(pushes)]
    at_limit = {j: float(np.sign(wanted[j])) for j in loops if abs(abs(wanted[j]) - levels[j]) < 1e-6}
    assert found is not None
    alone = np.abs(np.linalg.lstsq(rows.T, pushes, rcond=None)[0]) > levels
    if not holds and any(alone[j] for j in range(len(ends)) if j not in loops):
        # the loops may well hold where a contact outside them does not
        return
    assert found.holds == holds
    told = dict(zip(found.rows.tolist(), found.side.tolist(), strict=True))
    if holds:
        assert told == at_limit
        return
    # what lets go moves together: there is a motion that slips these contacts in these directions, and no others,
    # in which the loads do more work than the contacts at their levels take up
    moves = np.zeros(len(ends))
    for j, side in told.items():
        moves[j] = side
    slack = np.array([1.0 if j in told else 0.0 for j in range(len(ends))])
    program = linprog(
        levels @ (moves[:, None] * rows) - pushes,
        A_eq=rows[slack == 0],
        b_eq=np.zeros(int((slack == 0).sum())),
        A_ub=-(moves[:, None] * rows)[slack > 0],
        b_ub=np.zeros(int(slack.sum())),
        bounds=(-1.0, 1.0),
    )
    assert program.status == 0 and program.fun < -1e-6
