"""Nonnegative least squares: the conditions that its answer obeys, on random and degenerate problems."""

import numpy as np

from stickslip.events.nonnegative import nonnegative_least_squares


def check(matrix: np.ndarray, target: np.ndarray) -> None:
    x = nonnegative_least_squares(matrix, target)
    size = np.abs(matrix).max() * (np.abs(target).max() + 1)
    slope = matrix.T @ (matrix @ x - target)
    assert (x >= 0).all()
    assert slope.min(initial=0.0) >= -1e-10 * size
    assert np.abs(slope * x).max(initial=0.0) <= 1e-9 * size * (1 + x.max(initial=0.0))


def test_random_problems() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        n, m = rng.integers(1, 9, 2)
        matrix = rng.normal(size=(n, m))
        if rng.random() < 0.5:
            # of low rank, with repeated columns, and corners where many constraints meet
            matrix = matrix.round()
            matrix[:, rng.integers(m)] = matrix[:, 0]
        check(matrix, rng.normal(size=n) if rng.random() < 0.5 else matrix @ rng.integers(0, 2, m))


def test_nothing_at_all() -> None:
    assert nonnegative_least_squares(np.zeros((3, 0)), np.ones(3)).size == 0
    assert (nonnegative_least_squares(np.zeros((3, 2)), np.ones(3)) == 0).all()


def test_targets_that_are_almost_out_of_reach() -> None:
    """Weights of 1e4 to 1e8 have that much roundoff: it ends the rounds."""
    for seed in range(3000):
        rng = np.random.default_rng(seed)
        n, m = rng.integers(2, 7), rng.integers(3, 14)
        matrix, target = rng.integers(-2, 3, (n, m)).astype(float), np.zeros(n)
        matrix[-1] *= 10.0 ** -rng.integers(4, 8)
        target[-1] = 1.0
        x = nonnegative_least_squares(matrix, target)
        slope = matrix.T @ (matrix @ x - target)
        assert (x >= 0).all() and slope.min() >= -1e-10 * (1 + x.max())
