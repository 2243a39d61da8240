"""Accelerations and held forces against eq. (1), closed forms, and the dense equations they solve.

``M v' + G^T lambda = F`` and ``G v' + D u' = 0``: in 60 digits where the rows are independent, least norm of the
unit rows where they are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from stickslip.equations import balance
from stickslip.equations.balance import Balance, Components

KINDS = ["dense", "sparse", "trees"]
Array = np.ndarray
Row = dict[int, float]
"""Coefficients of bodies 0 to n - 1, then of drives; what is missing is on the ground."""


@dataclass(frozen=True)
class Case:
    """Held rows between bodies and drives, forces on the bodies and accelerations of the drives."""

    inertia: list[float]
    rows: list[Row]
    forces: list[float]
    drives: tuple[float, ...] = ()

    @property
    def n(self) -> int:
        return len(self.inertia)

    @property
    def G(self) -> Array:
        return self._columns(0, self.n)

    @property
    def D(self) -> Array:
        return self._columns(self.n, self.n + len(self.drives))

    def _columns(self, first: int, stop: int) -> Array:
        return np.array([[row.get(i, 0.0) for i in range(first, stop)] for row in self.rows]).reshape(
            len(self.rows), stop - first
        )

    def balanced(self, kind: str) -> Balance:
        """Balance them with dense matrices, component by component, or with every tree eliminated as a tree."""
        G: Any = self.G if kind == "dense" else sparse.csr_array(self.G)
        D: Any = self.D if kind == "dense" else sparse.csr_array(self.D)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(balance, "_SMALL", 0 if kind == "trees" else 60)
            return Balance(np.array(self.inertia), G, D)

    def solved(self, kind: str) -> tuple[Array, Array]:
        """Accelerations and held forces."""
        found, F, u = self.balanced(kind), np.array(self.forces), np.array(self.drives)
        a = found.accelerations(F, u)
        return a, found.held_forces(F, a, u)


def between(a: int, b: int) -> Row:
    """A contact between two bodies."""
    return {a: 1.0, b: -1.0}


def chain(n: int) -> list[Row]:
    return [between(i, i + 1) for i in range(n - 1)]


def exact(case: Case) -> tuple[Array, Array]:
    """Solve the independent rows' equations in 60 digits."""
    n, h = case.n, len(case.rows)
    with mpmath.workdps(60):
        matrix, right = mpmath.zeros(n + h), mpmath.zeros(n + h, 1)
        for i, (m, force) in enumerate(zip(case.inertia, case.forces, strict=True)):
            matrix[i, i], right[i] = mpmath.mpf(m), mpmath.mpf(force)
        for j, row in enumerate(case.rows):
            for i, c in row.items():
                if i < n:
                    matrix[n + j, i] = matrix[i, n + j] = mpmath.mpf(c)
                else:
                    right[n + j] -= mpmath.mpf(c) * mpmath.mpf(case.drives[i - n])
        found = [float(x) for x in mpmath.lu_solve(matrix, right)]
    return np.array(found[:n]), np.array(found[n:])


def least_norm(case: Case) -> tuple[Array, Array]:
    """Solve by pseudo-inverses: rows scaled to their largest coefficient, then the shortest forces."""
    G, D, M = case.G, case.D, np.diag(case.inertia)
    n = case.n
    scale = np.abs(np.hstack([G, D])).max(axis=1)
    unit, led = G / scale[:, None], D @ np.array(case.drives) / scale
    # orthonormal rows of the same constraints
    left, sizes, right = np.linalg.svd(unit)
    rank = int((sizes > 1e-9).sum())
    rows, pull = right[:rank], (left.T @ led)[:rank] / sizes[:rank]
    kkt = np.block([[M, rows.T], [rows, np.zeros((rank, rank))]])
    a = np.linalg.solve(kkt, np.concatenate([case.forces, -pull]))[:n]
    return a, np.linalg.pinv(unit.T, rcond=1e-9) @ (np.array(case.forces) - M @ a) / scale


# Trees


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("a", "b"), [(0, 1), (1, 0)])
def test_two_bodies_obey_equation_1(a: int, b: int, kind: str) -> None:
    """``lambda = (F_a m_b - F_b m_a) / (m_a + m_b)``."""
    m, F = [1.0, 10.0], [3.0, -5.0]
    acceleration, force = Case(m, [between(a, b)], F).solved(kind)
    assert force.tolist() == pytest.approx([(F[a] * m[b] - F[b] * m[a]) / 11], rel=1e-15)
    assert acceleration.tolist() == pytest.approx([-2 / 11, -2 / 11], rel=1e-15)
    assert acceleration[0] == acceleration[1]


TREES = [
    chain(6),
    [between(2, 1), between(2, 0), between(3, 2), between(2, 4), between(5, 2)],
    [between(0, 1), between(0, 2), between(3, 1), between(1, 4), between(5, 2)],
    [between(5, 4), between(1, 0), between(2, 3)],
    [between(3, 4)],
    [{1: -1.0}, between(1, 0), between(4, 1)],
]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rows", TREES)
def test_trees_agree_with_the_dense_equations(rows: list[Row], kind: str) -> None:
    case = Case([1.0, 2.0, 0.5, 4.0, 3.0, 7.0], rows, [1.0, -2.0, 3.0, 0.0, 5.0, -0.3])
    acceleration, force = case.solved(kind)
    expected = exact(case)
    np.testing.assert_allclose(acceleration, expected[0], rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(force, expected[1], rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rows", TREES)
def test_velocities_across_contacts_are_equal_to_the_bit(rows: list[Row], kind: str) -> None:
    case = Case([1.0, 2.0, 0.5, 4.0, 3.0, 7.0], rows, [0.0] * 6)
    found, G = case.balanced(kind), case.G
    T = found.T if kind == "dense" else found.T.toarray()
    assert set(np.unique(T).tolist()) <= {0.0, 1.0}
    assert np.all(G @ T == 0)
    assert found.dependent.size == len(rows) and np.all(T[:, found.dependent] == 0)
    independent = np.setdiff1d(np.arange(6), found.dependent)
    np.testing.assert_array_equal(T[independent][:, independent], np.eye(independent.size))
    v = np.array([0.1, 1 / 3, -0.7, 1e-17, 3e8, 2.2])
    for moved in (found.consistent(v, np.empty(0)), found.project(v, np.empty(0)), found.accelerations(v)):
        assert np.all(G @ moved == 0)


@pytest.mark.parametrize("kind", KINDS)
def test_projection_conserves_momentum(kind: str) -> None:
    """Two carriages that lock have the mean velocity, by mass; a third on the ground stands still."""
    case = Case([1.0, 3.0, 2.0], [between(0, 1), {2: 1.0}], [0.0] * 3)
    found = case.balanced(kind).project(np.array([2.0, -2.0, 5.0]), np.empty(0))
    assert found.tolist() == pytest.approx([-1.0, -1.0, 0.0], abs=1e-15)
    assert found[0] == found[1] and found[2] == 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "m",
    [
        [1.0, 1e12, 1.0, 1e-6],
        [1e12, 1.0, 1e12, 1.0],
        [1.0, 1.0, 1.0, 1e12],
        [1e-6, 1e6, 1e-6, 1e6],
    ],
)
def test_inertias_may_differ_by_eighteen_orders(m: list[float], kind: str) -> None:
    for forces in ([1.0, 0, 0, 0], [0, 0, 1.0, 0], [1.0, -2.0, 3.0, 0.7], [0, 0, 0, 1.0]):
        case = Case(m, chain(4), forces)
        (acceleration, force), expected = case.solved(kind), exact(case)
        # backward stable: as exact as the forces that enter
        np.testing.assert_allclose(force, expected[1], rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(acceleration, expected[0], rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_light_body_between_heavy_ones_keeps_its_digits(kind: str) -> None:
    case = Case([1e12, 1.0, 1e12], chain(3), [0.0, 1.0, 0.0])
    np.testing.assert_allclose(case.solved(kind)[1], exact(case)[1], rtol=1e-15)


@pytest.mark.parametrize("seed", range(5))
def test_chains_of_twenty_with_masses_over_24_decades(seed: int) -> None:
    numbers = np.random.default_rng(seed)
    m = (10.0 ** numbers.uniform(-12, 12, 20)).tolist()
    case = Case(m, chain(20), numbers.uniform(-1, 1, 20).tolist())
    expected = exact(case)
    for kind in KINDS:
        acceleration, force = case.solved(kind)
        np.testing.assert_allclose(acceleration, expected[0], rtol=1e-13, err_msg=kind)
        assert np.unique(acceleration).size == 1, kind
        scale = np.abs(case.forces).sum()
        np.testing.assert_allclose(force, expected[1], rtol=0, atol=1e-14 * scale, err_msg=kind)


@pytest.mark.parametrize("kind", KINDS)
def test_a_long_chain(kind: str) -> None:
    n = 400
    forces = np.cos(np.arange(n))
    _, found = Case([1.0] * n, chain(n), forces.tolist()).solved(kind)
    np.testing.assert_allclose(found, np.cumsum(forces - forces.mean())[:-1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_held(kind: str) -> None:
    case = Case([1.0, 2.0], [], [3.0, 4.0])
    acceleration, force = case.solved(kind)
    assert acceleration.tolist() == [3.0, 2.0] and force.shape == (0,)
    found = case.balanced(kind)
    assert found.dependent.size == 0 and found.loop.size == 0
    assert found.held_forces(np.ones((2, 5)), np.ones((2, 5))).shape == (0, 5)
    v = np.array([1.0, -1.0])
    assert found.project(v, np.empty(0)).tolist() == v.tolist()


# Ground and drives


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_group_on_the_ground_stands_still(kind: str, sign: float) -> None:
    case = Case([1.0, 2.0, 3.0], [between(0, 1), {1: sign}, between(1, 2)], [4.0, 5.0, 6.0])
    acceleration, force = case.solved(kind)
    assert acceleration.tolist() == [0.0, 0.0, 0.0]
    assert force.tolist() == pytest.approx([4.0, sign * 15.0, -6.0])


@pytest.mark.parametrize("kind", KINDS)
def test_a_drive_s_acceleration_pulls_its_group_along(kind: str) -> None:
    """The drive gives 1 kg + 2 kg 5 m/s2, beside loads of 1 N each: 3 5 - 2 = 13 N."""
    case = Case([1.0, 2.0, 3.0], [{3: 1.0, 0: -1.0}, between(0, 1)], [1.0, 1.0, 9.0], (5.0,))
    acceleration, force = case.solved(kind)
    assert acceleration.tolist() == pytest.approx([5.0, 5.0, 3.0], rel=1e-15)
    assert force.tolist() == pytest.approx([13.0, 1.0 - 5.0 + 13.0])
    led = case.balanced(kind).consistent(np.array([7.0, 8.0, 9.0]), np.array([0.1 + 0.2]))
    assert led.tolist() == [0.1 + 0.2, 0.1 + 0.2, 9.0]


@pytest.mark.parametrize("kind", KINDS)
def test_drives_that_part_pull_with_huge_forces(kind: str) -> None:
    """A block held by the floor and by a belt that accelerates with 0.5: huge opposite forces, whose sum is the 6 N."""
    case = Case([2.0], [{0: 1.0}, {0: 1.0, 1: -1.0}], [6.0], (0.0,))
    assert case.solved(kind)[1].tolist() == pytest.approx([3.0, 3.0])
    _, found = Case(case.inertia, case.rows, case.forces, (0.5,)).solved(kind)
    assert found[0] > 1e8 and found[1] < -1e8
    assert found.sum() == pytest.approx(6.0, abs=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_the_huge_forces_run_along_the_way_only(kind: str) -> None:
    """Floor - 0 - 1 - belt, with 2 hanging on 0, and 3 on its own."""
    rows = [{0: 1.0}, between(0, 1), {1: 1.0, 4: -1.0}, between(2, 0)]
    _, found = Case([1.0] * 4, rows, [0.0] * 4, (-3.0,)).solved(kind)
    assert found[2] > 1e8
    np.testing.assert_allclose(found / found[2], [-1.0, 1.0, 1.0, 0.0], rtol=0, atol=1e-9)


# Loops


@pytest.mark.parametrize("kind", KINDS)
def test_doubled_contacts_share_the_force(kind: str) -> None:
    case = Case([1.0, 1.0], [between(0, 1), between(1, 0), between(0, 1)], [6.0, 0.0])
    assert case.solved(kind)[1].tolist() == pytest.approx([1.0, -1.0, 1.0])
    assert np.unique(case.balanced(kind).loop).size == 1


@pytest.mark.parametrize("kind", KINDS)
def test_two_brakes_on_one_wheel(kind: str) -> None:
    acceleration, force = Case([2.0], [{0: 1.0}, {0: 1.0}], [6.0]).solved(kind)
    assert acceleration.tolist() == [0.0]
    assert force.tolist() == pytest.approx([3.0, 3.0])


@pytest.mark.parametrize("kind", KINDS)
def test_radii_are_scaled_to_the_largest_coefficient(kind: str) -> None:
    """Brakes on radii 2 and 0.5 of a wheel share the torque by halves: 2 r = 3 and 0.5 r = 3."""
    _, force = Case([2.0], [{0: 2.0}, {0: 0.5}], [6.0]).solved(kind)
    assert force.tolist() == pytest.approx([1.5, 6.0])
    # the drive's coefficient counts too: rows 4 v - 8 u and v - 2 u are one of each size
    _, force = Case([2.0], [{0: 4.0, 1: -8.0}, {0: 1.0, 1: -2.0}], [6.0], (0.0,)).solved(kind)
    assert force.tolist() == pytest.approx([0.75, 3.0])


@pytest.mark.parametrize("kind", KINDS)
def test_loops_are_numbered_apart_and_trees_are_none(kind: str) -> None:
    rows = [between(0, 1), between(1, 2), between(2, 0), between(2, 3), between(3, 4), between(4, 3)]
    loop = Case([1.0] * 6, rows, [0.0] * 6).balanced(kind).loop
    assert loop[3] == -1
    assert np.unique(loop[:3]).size == np.unique(loop[4:]).size == 1
    assert loop[0] >= 0 and loop[4] >= 0 and loop[0] != loop[4]


@pytest.mark.parametrize("kind", KINDS)
def test_a_ring_takes_the_least_forces(kind: str) -> None:
    rows = [between(0, 1), between(1, 2), between(2, 3), between(3, 0)]
    case = Case([1.0, 2.0, 3.0, 4.0], rows, [1.0, 0.0, -2.0, 0.5])
    acceleration, force = case.solved(kind)
    expected = least_norm(case)
    np.testing.assert_allclose(acceleration, expected[0], rtol=1e-12)
    np.testing.assert_allclose(force, expected[1], rtol=1e-12)
    # a force added all around the ring would make the norm larger
    assert sum(force) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_a_loop_of_very_different_inertias(kind: str) -> None:
    """The heavy body hardly moves: two thirds of the force go directly to it, one third through the light body."""
    case = Case([1.0, 1e12, 1e-3], [between(0, 1), between(1, 2), between(2, 0)], [1.0, 0.0, 0.0])
    np.testing.assert_allclose(case.solved(kind)[1], [2 / 3, -1 / 3, -1 / 3], rtol=1e-11)


def test_a_long_ring_keeps_its_digits() -> None:
    n = 300
    forces = np.cos(np.arange(n))
    rows = [between(i, (i + 1) % n) for i in range(n)]
    _, found = Case([1.0] * n, rows, forces.tolist()).solved("sparse")
    np.testing.assert_allclose(found - np.roll(found, 1), forces - forces.mean(), rtol=0, atol=1e-12)
    assert abs(found.sum()) < 1e-9


# Gears


@pytest.mark.parametrize("kind", KINDS)
def test_a_gear_reduces_inertia_by_the_square_of_its_ratio(kind: str) -> None:
    """``v_a = 3 v_b``: ``(9 m_a + m_b) v_b' = 3 F_a + F_b``."""
    acceleration, force = Case([2.0, 5.0], [{0: 1.0, 1: -3.0}], [4.0, -1.0]).solved(kind)
    assert acceleration.tolist() == pytest.approx([33 / 23, 11 / 23], rel=1e-15)
    assert force.tolist() == pytest.approx([4.0 - 2.0 * 33 / 23], rel=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_bodies_without_inertia_follow_where_others_decide(kind: str) -> None:
    """A planetary gear, ``(1 + 2) v_c = v_s + 2 v_r``, whose carrier has none: its forces are as 3 to -1 to -2."""
    case = Case([0.0, 2.0, 3.0], [{0: 3.0, 1: -1.0, 2: -2.0}], [1.0, 0.5, -1.0])
    acceleration, force = case.solved(kind)
    expected = exact(case)
    np.testing.assert_allclose(acceleration, expected[0], rtol=1e-14)
    np.testing.assert_allclose(force, [1 / 3], rtol=1e-14)


# Any scene


@st.composite
def cases(draw: st.DrawFn) -> Case:
    n, drives = draw(st.integers(1, 7)), draw(st.integers(0, 2))
    places = n + drives
    sizes = st.sampled_from([1.0, -1.0, 1.0, -1.0, 0.5, 2.0, -3.0, 0.3])
    rows: list[Row] = []
    for _ in range(draw(st.integers(0, 9))):
        some = draw(st.lists(st.integers(0, places - 1), min_size=1, max_size=3, unique=True))
        if min(some) < n:
            rows.append({i: draw(sizes) for i in some})
    m = draw(st.lists(st.floats(0.1, 10.0), min_size=n, max_size=n))
    forces = draw(st.lists(st.integers(-9, 9).map(float), min_size=n, max_size=n))
    return Case(m, rows, forces, (0.0,) * drives)


def independent(case: Case) -> bool:
    return not case.rows or np.linalg.matrix_rank(case.G, tol=1e-6) == len(case.rows)


def well_posed(case: Case) -> bool:
    """Whether its rank is beyond doubt."""
    if not case.rows:
        return True
    sizes = np.linalg.svd(case.G, compute_uv=False)
    return not ((sizes < 1e-3) & (sizes > 1e-12)).any()


@pytest.mark.slow
@settings(deadline=None, max_examples=200)
@given(cases(), st.floats(-5.0, 5.0))
def test_any_rows_in_all_ways_and_as_the_dense_equations_say(case: Case, pull: float) -> None:
    if not well_posed(case):
        return
    if independent(case):
        case = Case(case.inertia, case.rows, case.forces, (pull,) * len(case.drives))
        expected = exact(case)
    else:
        expected = least_norm(case)
    for kind in KINDS:
        acceleration, force = case.solved(kind)
        np.testing.assert_allclose(acceleration, expected[0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(force, expected[1], rtol=0, atol=1e-8)
        found = case.balanced(kind)
        rank = np.linalg.matrix_rank(case.G, tol=1e-6) if case.rows else 0
        assert found.dependent.size == rank
        assert (found.loop >= 0).any() == (rank < len(case.rows))


@settings(deadline=None, max_examples=50)
@given(cases())
def test_many_columns_of_forces_at_once(case: Case) -> None:
    wide = np.outer(case.forces, [1.0, -2.0, 0.0])
    for kind in KINDS:
        found = case.balanced(kind)
        accelerations = found.accelerations(wide)
        forces = found.held_forces(wide, accelerations)
        for k in range(3):
            alone = found.accelerations(wide[:, k])
            np.testing.assert_allclose(accelerations[:, k], alone, rtol=0, atol=1e-12)
            np.testing.assert_allclose(forces[:, k], found.held_forces(wide[:, k], alone), rtol=0, atol=1e-9)


@settings(deadline=None, max_examples=50)
@given(cases())
def test_majorants_bound_what_they_are_for(case: Case) -> None:
    """They are never less than the accelerations and forces that loads of at most these sizes cause."""
    if not well_posed(case):
        return
    F = np.array(case.forces)
    for kind in KINDS:
        found = case.balanced(kind)
        drives = np.linspace(-3.0, 2.0, found.U.shape[1])
        acceleration = found.accelerations(F, drives)
        slack = 1e-9 * (1 + np.abs(F).max())
        sizes = found.majorants(np.abs(F), np.abs(drives))
        assert np.all(sizes[0] >= np.abs(acceleration) - slack)
        assert np.all(sizes[1] >= np.abs(found.held_forces(F, acceleration, drives)) - slack)


# Components are remembered


@pytest.mark.parametrize("seed", range(6))
def test_components_met_before_give_the_same_balance(seed: int) -> None:
    """Few components change from one set of held rows to the next; remembered ones are equal to the bit."""
    rng = np.random.default_rng(seed)
    n, m = 40, 70
    ends = rng.integers(n, size=m)
    rows = [between(a, b) if (b := (a + 1) % n) and k % 3 else {a: 2.0, n: -1.0} for k, a in enumerate(ends)]
    case = Case(rng.uniform(0.5, 3, n).tolist(), rows, rng.normal(size=n).tolist(), (0.3,))
    G, D, M = sparse.csr_array(case.G), sparse.csr_array(case.D), np.array(case.inertia)
    components, F, u = Components(M, G, D), np.array(case.forces), np.array(case.drives)
    held = rng.random(m) < 0.7
    for j in rng.integers(m, size=12):
        held[j] ^= True
        own = held.nonzero()[0]
        known = Balance(M, G[own], D[own], lambda some, own=own: components.component(own[some]))
        anew = Balance(M, G[own], D[own])
        assert np.array_equal(known.loop, anew.loop)
        assert np.array_equal(known.accelerations(F, u), anew.accelerations(F, u))
        a = anew.accelerations(F, u)
        assert np.array_equal(known.held_forces(F, a, u), anew.held_forces(F, a, u))


def test_all_small_components_of_a_large_scene_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    """With less room than one balance needs, each component would be forgotten before it comes back."""
    count, made = 2500, 0
    G = sparse.kron(sparse.eye_array(count), np.array([[1.0, -1.0]]), format="csr")
    D, M = sparse.csr_array((count, 1)), np.ones(2 * count)
    plain = vars(balance)["_Component"]

    def counted(*arguments: Any) -> Any:
        nonlocal made
        made += 1
        return plain(*arguments)

    monkeypatch.setattr(balance, "_Component", counted)
    components = Components(M, G, D)
    rates = [Balance(M, G, D, components.component).accelerations(np.arange(2.0 * count)) for _ in range(2)]
    assert made == count
    # a pair shares the sum of its forces
    assert all(np.array_equal(rate, np.repeat(2.0 * np.arange(count) + 0.5, 2)) for rate in rates)
