"""How the changes of modes of two cycles differ, in words."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from stickslip.studies.cycles.phases import alike, in_words

STICK, SLIP, BACK = "c: FORWARD -> STUCK", "c: STUCK -> FORWARD", "c: FORWARD -> BACKWARD"
OTHER, AGAIN = "d: BACKWARD -> FORWARD", "d: FORWARD -> BACKWARD"


def having(*sequence: str) -> Any:
    return SimpleNamespace(sequence=sequence)


def test_cycles_are_alike_wherever_they_begin() -> None:
    assert alike(having(STICK, SLIP, OTHER), having(OTHER, STICK, SLIP))
    assert alike(having(), having())
    assert not alike(having(STICK, SLIP, OTHER), having(SLIP, STICK, OTHER))
    assert not alike(having(STICK, SLIP), having(STICK, SLIP, STICK, SLIP))
    assert not alike(having(STICK), having())


@pytest.mark.parametrize(
    ("one", "other", "words"),
    [
        ((OTHER, AGAIN), (OTHER, STICK, SLIP, AGAIN), "'c' begins to stick (its relative velocity grazes 0)"),
        (
            (STICK, SLIP, OTHER, AGAIN),
            (STICK, SLIP),
            "'d' ceases to reverse (its relative velocity grazes 0)",
        ),
        (
            ("s: OPEN -> OPEN", STICK, SLIP),
            (STICK, SLIP),
            "'s' ceases to be met (its stretch only just comes to a limit)",
        ),
        ((STICK, SLIP), (BACK, SLIP), "'c' changes its order of sticking, reversing and slipping"),
        (
            (STICK, SLIP),
            (OTHER, AGAIN),
            "'d' begins to reverse (its relative velocity grazes 0); "
            "'c' ceases to stick (its relative velocity grazes 0)",
        ),
        ((STICK, SLIP, OTHER), (SLIP, STICK, OTHER), "the same changes of modes come in another order"),
    ],
)
def test_what_begins_and_ceases_is_named(one: tuple[str, ...], other: tuple[str, ...], words: str) -> None:
    assert in_words(having(*one), having(*other)) == words


def test_names_come_in_order() -> None:
    said = in_words(having(), having(*(f"{name}: FORWARD -> STUCK" for name in "zayhckwpbm")))
    assert [part[:3] for part in said.split("; ")] == [f"'{name}'" for name in sorted("zayhckwpbm")]
