"""Rows over bad input: each must be refused before any solver starts, in words that name element, value and remedy."""

from __future__ import annotations

from functools import partial
from unittest import mock

from validation.bad_elements import ELEMENTS, LAWS, SIGNALS, Case
from validation.bad_scenes import ARGUMENTS, DATA, SCENES
from validation.rows import Row, Tried, Wrong, require
from validation.tried import try_each

TABLES: dict[str, list[Case]] = {
    "signals": SIGNALS,
    "laws": LAWS,
    "elements": ELEMENTS,
    "scenes": SCENES,
    "scene-files": DATA,
    "arguments": ARGUMENTS,
}
PATIENCE = 5.0


def refusal(case: Case) -> float:
    """Return 0 where a case ends in the right error, before an engine is made; raise `Wrong` otherwise."""
    make, kind, words = case
    started = mock.Mock(side_effect=Wrong("an engine was made before the input was checked"))
    try:
        with mock.patch("stickslip.simulation.simulate.Task", started):
            make()
    except kind as error:
        require(type(error) is kind, f"{type(error).__name__} instead of {kind.__name__}: {error}")
        missing = [word for word in words if word not in str(error)]
        require(not missing, f"the error does not say {', '.join(missing)}: {error}")
        return 0.0
    raise Wrong("an answer where there is none: an error was expected")


def refusals(table: str) -> Tried:
    """Try all cases of a table."""
    items = ((f"{i}: {case[2][0]}", partial(refusal, case)) for i, case in enumerate(TABLES[table]))
    return try_each(items, limit=PATIENCE)


ROWS = [
    Row(
        "Robustness",
        f"bad-input-{table}",
        f"{len(cases)} kinds of bad {table.replace('-', ' ')}: refused before any solver starts",
        "an error that names element, value and remedy",
        partial(refusals, table),
        0.0,
        tries="bad inputs",
    )
    for table, cases in TABLES.items()
]
