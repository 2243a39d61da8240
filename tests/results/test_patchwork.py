"""What is known part by part: polynomials in runs, and the largest of overlapping ranges, against the plain way."""

import numpy as np
import pytest

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
    held = series.held(np.full(times, count), slice(None))
    values, moved = (series.values(held, t, unit, integrated) for integrated in (False, True))
    for k in range(count):
        own = np.polynomial.Polynomial(terms[k])
        s = (t - origin[k]) / unit
        assert values[k] == pytest.approx(own(s), rel=1e-13, abs=1e-13)
        assert moved[k] == pytest.approx(begin[k] + unit * own.integ()(s), rel=1e-13, abs=1e-13)
