"""Reading one name from several runs in a row: not every run has every body and contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip.results.outcome import Outcome
from stickslip.results.samples import Samples

BETWEEN = "between two runs"  # the cause of changes from the end of one run to the start of the next

T = TypeVar("T")


def of_each(runs: Sequence[Outcome], read: Callable[[Samples], T]) -> list[T | None]:
    """Return what `read` returns for each run, and None where a run does not have the name.

    If no run has it, the ValueError of the last one is raised.
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

    `sizes` are the numbers of times in the runs.
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
