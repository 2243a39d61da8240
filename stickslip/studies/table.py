"""Tables of a study as aligned text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence


def aligned(
    lead: Sequence[str],
    columns: Mapping[str, Sequence[float]],
    tail: Sequence[str],
    *,
    title: str = "  setup",
    note: str,
) -> str:
    """Return an aligned table with a `note` below it; columns without numbers are left out.

    A line begins with its `lead` and ends with its `tail`, of which only the first line is shown; between stand the
    numbers of the `columns` by title, NaN where there is none.
    """
    cells = {name: [_cell(value) for value in column] for name, column in columns.items()}
    cells = {name: column for name, column in cells.items() if any(column)}
    left = max(len(text) for text in [title, *lead])
    table = [[title.ljust(left)], *([text.ljust(left)] for text in lead)]
    for name, column in cells.items():
        wide = max(len(text) for text in [name, *column])
        for line, text in zip(table, [name, *column], strict=True):
            line.append(text.rjust(wide))
    ends = ["", *("  " + text.splitlines()[0] if text else "" for text in tail)]
    lines = ["  ".join(line) + end for line, end in zip(table, ends, strict=True)]
    return "\n".join([*(line.rstrip() for line in lines), note])


def _cell(value: float) -> str:
    if math.isnan(value):
        return ""
    return str(int(value)) if float(value).is_integer() and 0 < abs(value) < 1e9 else f"{value:.3g}"
