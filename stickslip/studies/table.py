"""Tables of a study as aligned text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any


def aligned(
    rows: Sequence[Any],
    front: Sequence[Any],
    kind: str,
    columns: Mapping[str, Sequence[float]],
    ends: Sequence[str],
) -> str:
    """Return the rows of a study as an aligned table; columns without numbers are left out.

    A row has a name, and a `failure` that is not None where it failed; those on the `front` are marked. `kind` is what
    a row is called. Behind its name stand the numbers of the `columns` by title, NaN where there is none, and what its
    line ends with: the first line of its failure, or that of `ends`.
    """
    title = f"  {kind}"
    lead = ["* " + row.name if row in front else "  " + row.name for row in rows]
    tail = [f"FAILED {row.failure}" if row.failure else end for row, end in zip(rows, ends, strict=True)]
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
    return "\n".join([*(line.rstrip() for line in lines), f"* no other {kind} is both faster and more accurate"])


def _cell(value: float) -> str:
    if math.isnan(value):
        return ""
    return str(int(value)) if float(value).is_integer() and 0 < abs(value) < 1e9 else f"{value:.3g}"
