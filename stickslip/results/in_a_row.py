"""What several runs in a row know of one name: not every run has every body and contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip.results.outcome import Outcome
from stickslip.results.samples import Samples

T = TypeVar("T")


def of_each(runs: Sequence[Outcome], read: Callable[[Samples], T]) -> list[T | None]:
    """Return what is read of each run, and None where a run does not know what it is asked for.

    If no run knows it, its ValueError goes on.
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


def joined(parts: Sequence[NDArray[Any] | None], sizes: Sequence[int]) -> NDArray[Any]:
    """Return arrays one after another along their last axis, with NaN where one is missing or has fewer lines.

    `sizes` are how many times each has.
    """
    known = [part for part in parts if part is not None]
    lines = max(part.shape[:-1] for part in known)
    if len(known) == len(parts) and all(part.shape[:-1] == lines for part in known):
        return np.concatenate(known, axis=-1)
    whole = np.full((*lines, sum(sizes)), np.nan)
    stop = 0
    for part, size in zip(parts, sizes, strict=True):
        start, stop = stop, stop + size
        if part is not None:
            whole[(*map(slice, part.shape[:-1]), slice(start, stop))] = part
    return whole
