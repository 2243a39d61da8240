"""Nonnegative least squares, after Lawson and Hanson (Solving Least Squares Problems, 1974, ch. 23).

`scipy.optimize.nnls` (1.17) is not used: in degenerate cases it returns wrong answers with residual 0.
"""

from __future__ import annotations

import numpy as np

from stickslip.model.arrays import Array, Mask

_TINY = 1e-13
_ROUNDS = 100


def nonnegative_least_squares(matrix: Array, target: Array) -> Array:
    """Return the ``x >= 0`` for which ``|matrix x - target|`` is least.

    The columns in use are linearly independent, because each enters with a part that the others cannot explain. Each
    round leaves a smaller residual than all before, so no set of columns comes twice, and the rounds end.

    Raises an ArithmeticError if roundoff keeps the rounds from ending.
    """
    count = matrix.shape[1]
    x, in_use = np.zeros(count), np.zeros(count, dtype=bool)
    sizes, norms, wanted = np.abs(matrix), np.linalg.norm(matrix, axis=0), np.linalg.norm(target)
    for _ in range(_ROUNDS * (count + 1)):
        least = _TINY * norms * (wanted + np.linalg.norm(sizes @ x))
        slope = np.where(in_use, 0.0, matrix.T @ (target - matrix @ x) - least)
        while True:
            entering = int(slope.argmax()) if count else 0
            if not count or slope[entering] <= 0:
                return x
            in_use[entering] = True
            trial = _solved(matrix, target, in_use)
            if trial[entering] > 0:
                break
            # only roundoff let this column in
            in_use[entering], slope[entering] = False, 0.0
        while (trial[in_use] <= 0).any():
            falling = in_use & (trial <= 0)
            part = float((x[falling] / (x[falling] - trial[falling])).min())
            x = x + part * (trial - x)
            leaving = falling & (x <= _TINY * np.abs(x).max(initial=0.0))
            in_use[leaving] = False
            x[~in_use] = 0.0
            trial = _solved(matrix, target, in_use)
        x = trial
    raise ArithmeticError("an impact or a share of forces is too ill-conditioned to solve")


def _solved(matrix: Array, target: Array, in_use: Mask) -> Array:
    found = np.zeros(in_use.size)
    found[in_use] = np.linalg.lstsq(matrix[:, in_use], target, rcond=None)[0]
    return found
