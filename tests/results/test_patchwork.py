"""Pieces known part by part: polynomials in runs, and the largest of overlapping ranges, against plain loops."""

from itertools import pairwise

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, Spring, simulate
from stickslip.results.patchwork import SeriesOfMany, _largest_over


@pytest.mark.parametrize("seed", range(20))
def test_the_largest_of_ranges_that_overlap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, count = int(rng.integers(1, 40)), int(rng.integers(0, 20))
    first = rng.integers(0, size, count)
    last = np.minimum(first + rng.integers(1, size + 1, count), size)
    values, plain = rng.random(count), np.zeros(size)
    for a, b, value in zip(first, last, values, strict=True):
        plain[a:b] = np.maximum(plain[a:b], value)
    assert _largest_over(first, last, values, size).tolist() == plain.tolist()


@pytest.mark.parametrize("times", [1, 7, 8, 9, 40])
def test_values_and_integrals_are_those_of_each_polynomial(times: int) -> None:
    """Entries of degrees 0 to 11, each read at some times in a row: ``c(s)`` and the integral from its origin."""
    rng, unit, count = np.random.default_rng(times), 0.5, 12
    terms = rng.normal(size=(count, 12)) * (np.arange(12) <= np.arange(count)[:, None])
    number, origin, begin = np.arange(count), rng.random(count), rng.random(count)
    series = SeriesOfMany(number, number, origin, begin, np.zeros(count), terms)
    t = np.sort(rng.random(times))
    valid = series.valid(np.full(times, count), slice(None))
    values, moved = (series.values(valid, t, unit, integrated) for integrated in (False, True))
    for k in range(count):
        own = np.polynomial.Polynomial(terms[k])
        s = (t - origin[k]) / unit
        assert values[k] == pytest.approx(own(s), rel=1e-13, abs=1e-13)
        assert moved[k] == pytest.approx(begin[k] + unit * own.integ()(s), rel=1e-13, abs=1e-13)


def test_pieces_of_a_run_that_was_followed_part_by_part_begin_with_its_states() -> None:
    """20 blocks on a belt, each with a spring of its own and joined to its neighbours."""
    names = [f"b{k}" for k in range(20)]
    scene = Scene(
        Drive("belt", velocity=0.3),
        *(Body(name, inertia=1.0, position=0.5 + 0.5 * np.sin(7.3 * k)) for k, name in enumerate(names)),
        *(Contact(f"c{name}", name, "belt", DryFriction(0.35, 0.2), normal=5.0) for name in names),
        *(Spring(name, GROUND, stiffness=1.0, damping=0.05) for name in names),
        *(Spring(a, b, stiffness=3.0) for a, b in pairwise(names)),
    )
    result = simulate(scene, (0.0, 3.0))
    pieces = result.trajectory.pieces
    assert result.trajectory.is_patchwork
    assert len(pieces) > 10
    for piece in (pieces[0], pieces[5], pieces[-1]):
        np.testing.assert_allclose(piece.y, result(piece.t), rtol=0, atol=1e-13)
        assert piece.stop == pytest.approx(piece.t + piece.end, abs=1e-13)
