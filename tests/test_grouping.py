"""Rigid groups and their contact forces, against eq. (1) and against the dense equations they solve."""

from dataclasses import dataclass

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip import grouping
from stickslip.grouping import Groups

SIZES = ["few", "many"]


def make(inertia: list[float], contacts: list[tuple[int, int]], size: str) -> Groups:
    """Both ways of grouping: for few bodies and for many."""
    a, b = np.array(contacts, dtype=np.intp).reshape(-1, 2).T
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grouping, "_SMALL", 10**9 if size == "few" else -1)
        return Groups(np.array(inertia), a, b)


def incidence(contacts: list[tuple[int, int]], n: int) -> np.ndarray:
    """One row per contact, +1 at a and -1 at b, for free bodies only."""
    G = np.zeros((len(contacts), n))
    for row, (i, j) in enumerate(contacts):
        for end, sign in ((i, 1.0), (j, -1.0)):
            if end < n:
                G[row, end] += sign
    return G


def driven(contacts: list[tuple[int, int]], n: int, acceleration: float) -> np.ndarray:
    """What prescribed bodies, all of one acceleration, add to the relative accelerations."""
    sides = [(i >= n) * 1.0 - (j >= n) * 1.0 for i, j in contacts]
    return acceleration * np.array(sides)


def exact(inertia: list[float], contacts: list[tuple[int, int]], forces: list[float]) -> list[float]:
    """Solve ``G M^-1 G^T lambda = G M^-1 F`` for a tree in 60 digits."""
    with mpmath.workdps(60):
        G = mpmath.matrix(incidence(contacts, len(inertia)).tolist())
        W = mpmath.diag([1 / mpmath.mpf(m) for m in inertia])
        return [float(x) for x in mpmath.lu_solve(G * W * G.T, G * W * mpmath.matrix(forces))]


def dense(
    inertia: list[float], contacts: list[tuple[int, int]], forces: np.ndarray, pull: float
) -> np.ndarray:
    """Solve the same in doubles, least norm, with prescribed bodies that accelerate."""
    n = len(inertia)
    G, W = incidence(contacts, n), np.diag(1 / np.array(inertia))
    return np.linalg.pinv(G @ W @ G.T, rcond=1e-12) @ (G @ W @ forces + driven(contacts, n, pull))


# trees


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("contact", [(0, 1), (1, 0)])
def test_two_bodies_obey_equation_1(contact: tuple[int, int], size: str) -> None:
    m, F = [1.0, 10.0], [3.0, -5.0]
    g = make(m, [contact], size)
    a, b = contact
    expected = (F[a] * m[b] - F[b] * m[a]) / (m[0] + m[1])
    assert g.contact_forces(np.array(F), np.zeros(2)) == pytest.approx([expected], rel=1e-15)
    assert g.mean(np.array(F)) == pytest.approx([-2 / 11, -2 / 11])
    assert (g.leader.tolist(), g.holder.tolist(), g.mass.tolist()) == ([0, 0], [-1, -1], [11.0, 11.0])
    assert not g.redundant


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    "contacts",
    [
        [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5)],  # a chain
        [(2, 1), (2, 0), (3, 2), (2, 4), (5, 2)],  # a star
        [(0, 1), (0, 2), (3, 1), (1, 4), (5, 2)],  # a tree
        [(5, 4), (1, 0), (2, 3)],  # three pairs
        [(3, 4)],
    ],
)
def test_trees_agree_with_the_dense_equations(contacts: list[tuple[int, int]], size: str) -> None:
    m, F = [1.0, 2.0, 0.5, 4.0, 3.0, 7.0], [1.0, -2.0, 3.0, 0.0, 5.0, -0.3]
    g = make(m, contacts, size)
    found = g.contact_forces(np.array(F), np.zeros(6))
    np.testing.assert_allclose(found, exact(m, contacts, F), rtol=1e-13, atol=1e-14)
    # every member accelerates as its group does
    G = incidence(contacts, 6)
    np.testing.assert_allclose((np.array(F) - G.T @ found) / m, g.mean(np.array(F)), rtol=0, atol=1e-13)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    "m",
    [
        [1.0, 1e12, 1.0, 1e-6],
        [1e12, 1.0, 1e12, 1.0],
        [1.0, 1.0, 1.0, 1e12],
        [1e-6, 1e6, 1e-6, 1e6],
    ],
)
def test_inertias_may_differ_by_twelve_orders(m: list[float], size: str) -> None:
    contacts = [(0, 1), (1, 2), (2, 3)]
    for forces in ([1.0, 0, 0, 0], [0, 0, 1.0, 0], [1.0, -2.0, 3.0, 0.7], [0, 0, 0, 1.0]):
        found = make(m, contacts, size).contact_forces(np.array(forces), np.zeros(4))
        # backward stable: as exact as the forces that enter
        np.testing.assert_allclose(found, exact(m, contacts, forces), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("size", SIZES)
def test_a_light_body_between_heavy_ones_keeps_its_digits(size: str) -> None:
    m, contacts = [1e12, 1.0, 1e12], [(0, 1), (1, 2)]
    found = make(m, contacts, size).contact_forces(np.array([0.0, 1.0, 0.0]), np.zeros(3))
    np.testing.assert_allclose(found, exact(m, contacts, [0.0, 1.0, 0.0]), rtol=1e-15)


@pytest.mark.parametrize("size", SIZES)
def test_a_long_chain(size: str) -> None:
    n = 400
    contacts = [(i, i + 1) for i in range(n - 1)]
    forces = np.cos(np.arange(n))
    found = make([1.0] * n, contacts, size).contact_forces(forces, np.zeros(n))
    expected = np.cumsum(forces - forces.mean())[:-1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("size", SIZES)
def test_nothing_stuck(size: str) -> None:
    g = make([1.0, 2.0], [], size)
    assert g.leader.tolist() == [0, 1]
    assert g.free.all()
    assert g.mass.tolist() == [1.0, 2.0]
    assert g.mean(np.array([3.0, 4.0])).tolist() == [3.0, 2.0]
    assert g.contact_forces(np.ones(2), np.zeros(2)).shape == (0,)
    assert g.contact_forces(np.ones((2, 5)), np.zeros((2, 5))).shape == (0, 5)


# groups that a prescribed body holds


@pytest.mark.parametrize("size", SIZES)
def test_a_group_stuck_to_the_ground_stands_still(size: str) -> None:
    # bodies 0-1-2 in a chain, 1 on the ground (3), body order of the brake's contact either way
    for brake, sign in (((1, 3), 1.0), ((3, 1), -1.0)):
        g = make([1.0, 2.0, 3.0], [(0, 1), brake, (1, 2)], size)
        assert g.holder.tolist() == [3, 3, 3]
        assert not g.free.any()
        F = np.array([4.0, 5.0, 6.0])
        assert g.mean(F).tolist() == [0.0, 0.0, 0.0]
        assert g.contact_forces(F, np.zeros(3)).tolist() == pytest.approx([4.0, sign * 15.0, -6.0])


@pytest.mark.parametrize("size", SIZES)
def test_a_drive_s_acceleration_pulls_its_group_along(size: str) -> None:
    m, contacts = [1.0, 2.0, 3.0], [(3, 0), (0, 1)]
    g = make(m, contacts, size)
    assert g.holder.tolist() == [3, 3, -1]
    F = np.array([1.0, 1.0, 9.0])
    found = g.contact_forces(F, np.array([5.0, 5.0, 0.0]))
    # the drive pushes with r what is needed beyond F: (1 + 2) 5 - 2
    assert found.tolist() == pytest.approx([13.0, 1.0 - 5.0 * 1.0 + 13.0])
    np.testing.assert_allclose(found, dense(m, contacts, F, 5.0), rtol=1e-12)
    assert g.mean(F).tolist() == [0.0, 0.0, 3.0]


@pytest.mark.parametrize("size", SIZES)
def test_groups_held_by_one_body_stay_groups_of_their_own(size: str) -> None:
    g = make([1.0, 2.0, 3.0, 4.0], [(0, 4), (1, 4), (1, 2)], size)
    assert g.leader.tolist() == [0, 1, 1, 3]
    assert g.holder.tolist() == [4, 4, 4, -1]
    assert g.mass.tolist() == [1.0, 5.0, 5.0, 4.0]


@pytest.mark.parametrize("size", SIZES)
def test_of_several_holders_the_first_contact_s_counts(size: str) -> None:
    g = make([1.0, 2.0], [(0, 1), (1, 3), (0, 2)], size)
    assert g.holder.tolist() == [3, 3]
    assert g.redundant


# loops


@pytest.mark.parametrize("size", SIZES)
def test_doubled_contacts_share_the_force(size: str) -> None:
    g = make([1.0, 1.0], [(0, 1), (1, 0), (0, 1)], size)
    assert g.redundant
    found = g.contact_forces(np.array([6.0, 0.0]), np.zeros(2))
    assert found.tolist() == pytest.approx([1.0, -1.0, 1.0])


@pytest.mark.parametrize("size", SIZES)
def test_a_brake_on_a_wheel_that_is_stuck_to_the_ground_already(size: str) -> None:
    g = make([2.0], [(0, 1), (0, 1)], size)
    assert g.contact_forces(np.array([6.0]), np.zeros(1)).tolist() == pytest.approx([3.0, 3.0])
    assert g.mean(np.array([6.0])).tolist() == [0.0]


@pytest.mark.parametrize("size", SIZES)
def test_a_ring_takes_the_least_forces(size: str) -> None:
    m, contacts, F = [1.0, 2.0, 3.0, 4.0], [(0, 1), (1, 2), (2, 3), (3, 0)], np.array([1.0, 0, -2.0, 0.5])
    found = make(m, contacts, size).contact_forces(F, np.zeros(4))
    np.testing.assert_allclose(found, dense(m, contacts, F, 0.0), rtol=1e-12)
    # nothing can be added all around the ring that makes the forces smaller
    assert sum(found) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("size", SIZES)
def test_a_loop_through_the_ground(size: str) -> None:
    m, contacts, F = [1.0, 2.0], [(0, 2), (0, 1), (2, 1)], np.array([3.0, 1.0])
    found = make(m, contacts, size).contact_forces(F, np.zeros(2))
    np.testing.assert_allclose(found, dense(m, contacts, F, 0.0), rtol=1e-12)


@pytest.mark.parametrize("size", SIZES)
def test_a_loop_of_very_different_inertias(size: str) -> None:
    m = [1.0, 1e12, 1e-3]
    found = make(m, [(0, 1), (1, 2), (2, 0)], size).contact_forces(np.array([1.0, 0.0, 0.0]), np.zeros(3))
    # the heavy body hardly moves: two thirds of the force go there at once, one third over the light one
    np.testing.assert_allclose(found, [2 / 3, -1 / 3, -1 / 3], rtol=1e-11)


def test_a_long_ring_keeps_its_digits() -> None:
    n = 3000
    forces = np.cos(np.arange(n))
    g = make([1.0] * n, [(i, (i + 1) % n) for i in range(n)], "many")
    found = g.contact_forces(forces, np.zeros(n))
    left = forces - forces.mean()
    np.testing.assert_allclose(found - np.roll(found, 1), left, rtol=0, atol=1e-12)
    assert abs(found.sum()) < 1e-8


# a group stuck to prescribed bodies that part


@pytest.mark.parametrize("size", SIZES)
def test_prescribed_bodies_that_accelerate_apart_pull_with_huge_forces(size: str) -> None:
    # a block between the floor (1) and a belt (2) that accelerates with 0.5
    g = make([2.0], [(0, 1), (0, 2)], size)
    F = np.array([6.0])
    calm = g.contact_forces(F, np.zeros(1), parting=np.zeros(2))
    assert calm.tolist() == pytest.approx([3.0, 3.0])
    found = g.contact_forces(F, np.zeros(1), parting=np.array([0.0, -0.5]))
    # dragged forward over the floor and backward over the belt, both with the same force, F aside
    assert found[0] > 1e8
    assert found[1] < -1e8
    assert found.sum() == pytest.approx(6.0, abs=1e-5)


@pytest.mark.parametrize("size", SIZES)
def test_the_huge_forces_run_along_the_way_only(size: str) -> None:
    # floor (4) - 0 - 1 - belt (5), with 2 hanging on 0 and 3 on its own
    contacts = [(0, 4), (0, 1), (1, 5), (2, 0)]
    g = make([1.0, 1.0, 1.0, 1.0], contacts, size)
    parting = np.array([0.0, 0.0, 3.0, 0.0])
    wide = np.stack([parting, np.zeros(4)], axis=1)
    found = g.contact_forces(np.zeros((4, 2)), np.zeros((4, 2)), parting=wide)
    assert found[2, 0] > 1e8
    np.testing.assert_allclose(found[:, 0] / found[2, 0], [-1.0, 1.0, 1.0, 0.0], rtol=0, atol=1e-12)
    assert not found[:, 1].any()


# any graph


@dataclass
class Case:
    m: list[float]
    contacts: list[tuple[int, int]]
    forces: list[float]
    pull: float


@st.composite
def cases(draw: st.DrawFn) -> Case:
    n = draw(st.integers(1, 7))
    prescribed = draw(st.integers(0, 2))
    pairs = [(i, j) for i in range(n + prescribed) for j in range(n + prescribed) if i != j and min(i, j) < n]
    contacts = draw(st.lists(st.sampled_from(pairs), max_size=9)) if pairs else []
    m = draw(st.lists(st.floats(0.1, 10.0), min_size=n, max_size=n))
    forces = draw(st.lists(st.integers(-9, 9).map(float), min_size=n, max_size=n))
    return Case(m, contacts, forces, draw(st.integers(-5, 5).map(float)))


@pytest.mark.slow
@settings(deadline=None)
@given(cases())
def test_any_graph_both_ways_and_as_the_dense_equations_say(case: Case) -> None:
    n, F = len(case.m), np.array(case.forces)
    G, expected = incidence(case.contacts, n), dense(case.m, case.contacts, F, case.pull)
    few, many = make(case.m, case.contacts, "few"), make(case.m, case.contacts, "many")
    assert few.leader.tolist() == many.leader.tolist()
    assert few.holder.tolist() == many.holder.tolist()
    rank = np.linalg.matrix_rank(G) if G.size else 0  # older numpy has none for a matrix without entries
    assert few.redundant == many.redundant == (rank < len(case.contacts))
    for g in (few, many):
        held = np.where(g.free, 0.0, case.pull)
        found = g.contact_forces(F, held)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)  # the pseudo-inverse is no better
        # newton's law, body by body, with equal accelerations across every contact
        acceleration = (F - G.T @ found) / case.m
        np.testing.assert_allclose(acceleration, g.mean(F) + held, rtol=0, atol=1e-11)
        np.testing.assert_allclose(G @ acceleration + driven(case.contacts, n, case.pull), 0, atol=1e-10)
    np.testing.assert_allclose(few.mass, many.mass, rtol=1e-14)


@settings(deadline=None)
@given(cases())
def test_many_columns_of_forces_at_once(case: Case) -> None:
    wide = np.outer(case.forces, [1.0, -2.0, 0.0])
    for size in SIZES:
        g = make(case.m, case.contacts, size)
        held = np.outer(np.where(g.free, 0.0, case.pull), [1.0, -2.0, 0.0])
        found, mean = g.contact_forces(wide, held), g.mean(wide)
        for k in range(3):
            np.testing.assert_allclose(
                found[:, k], g.contact_forces(wide[:, k], held[:, k]), rtol=0, atol=1e-11
            )
            np.testing.assert_allclose(mean[:, k], g.mean(wide[:, k]), rtol=0, atol=1e-13)
