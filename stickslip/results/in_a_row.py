"""What several runs in a row know of one name: not every run has every body and contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip.results.outcome import Outcome
from stickslip.results.samples import Samples

__all__ = ["joined", "of_each"]

T = TypeVar("T")


def of_each(runs: Sequence[Outcome], read: Callable[[Samples], T]) -> list[T | None]:
    """Return what is read of each run, and None where a run does not know what it is asked for.

    Raises
    ------
    ValueError
        If no run knows it.
    """
    found: list[T | None] = []
    fault: ValueError | None = None
    for run in runs:
        try:
            found.append(read(run.samples))
        except ValueError as error:
            found.append(None)
            fault = error
    if fault is not None and all(part is None for part in found):
        raise fault
    return found


def joined(parts: Sequence[NDArray[np.generic] | None], sizes: Sequence[int]) -> NDArray[np.generic]:
    """Return arrays one after another along their last axis; NaN as many times as said where one is missing.

    Raises
    ------
    ValueError
        If they differ in their other axes.
    """
    shapes = {part.shape[:-1] for part in parts if part is not None}
    if len(shapes) > 1:
        raise ValueError(
            "the runs have different numbers of outputs or states here; read each of them by itself"
        )
    shape = shapes.pop()
    return np.concatenate(
        [
            np.full((*shape, size), np.nan) if part is None else part
            for part, size in zip(parts, sizes, strict=True)
        ],
        axis=-1,
    )
