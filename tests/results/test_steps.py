"""Paths read side by side give what each gives by itself."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.equations.path import Path
from stickslip.results import steps
from stickslip.results.steps import Blocks

SIZE = 3


def path(rng: np.random.Generator, count: int, terms: int, is_chebyshev: bool) -> Path:
    """A path of some steps, one of them without length, that ends in a state of its own."""
    lengths = rng.random(count)
    lengths[1:2] = 0.0
    taus = np.append(0.0, np.cumsum(lengths))
    coefficients = rng.normal(size=(count, terms, SIZE))
    return Path(taus, coefficients, rng.normal(size=SIZE), False, is_chebyshev)


def integral(one: Path, tau: float) -> np.ndarray:
    """From the start of a path to a local time, by Gauss quadrature in each step."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    total = np.zeros(SIZE)
    for begin, end in zip(one.taus[:-1], one.taus[1:], strict=True):
        stop = min(end, tau)
        if stop > begin:
            at = 0.5 * (begin + stop) + 0.5 * (stop - begin) * nodes
            total += 0.5 * (stop - begin) * (weights @ one.at(at))
    return total


@pytest.mark.parametrize("at_once", [1, 40, 50_000])
@pytest.mark.parametrize("is_chebyshev", [False, True])
def test_values_and_integrals_are_those_of_each_path(
    monkeypatch: pytest.MonkeyPatch, is_chebyshev: bool, at_once: int
) -> None:
    monkeypatch.setattr(steps, "_COEFFICIENTS_AT_ONCE", at_once)
    rng = np.random.default_rng(at_once)
    # the third is only a state
    paths = [path(rng, count, terms, is_chebyshev) for count, terms in ((1, 2), (4, 7), (0, 1), (3, 2), (2, 9))]
    blocks = Blocks(paths)
    taken = rng.permutation(np.repeat([0, 1, 2, 4], 12))
    ends = np.array([one.taus[-1] for one in paths])[taken]
    taus = rng.choice([0.0, 0.3, 0.7, 1.0], size=taken.size) * ends
    found, moved = np.full((2, taken.size, SIZE), np.nan)
    for some, own, side_by_side in blocks.of(taken):
        found[some] = side_by_side.values(own, taus[some])
        moved[some, :2] = side_by_side.integrals(own, taus[some], 2)
    for k, number in enumerate(taken.tolist()):
        one = paths[number]
        assert found[k] == pytest.approx(one.at(taus[k : k + 1])[0], rel=1e-13, abs=1e-13)
        assert moved[k, :2] == pytest.approx(integral(one, taus[k])[:2], rel=1e-12, abs=1e-12)
    # at the end of a path it is the state there, to the bit
    at_end = taus == ends
    np.testing.assert_array_equal(found[at_end], np.array([one.last for one in paths])[taken[at_end]])
    assert sum(block.paths for block in blocks) == len(paths)
