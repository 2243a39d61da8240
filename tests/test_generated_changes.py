"""Changes drawn from the syntax tree: what is changed, which ones are drawn, and what becomes of them."""

from __future__ import annotations

import ast
import shutil
from pathlib import Path

import pytest
import recording
from source_changes import KINDS, Change, changes_of, sample
from survivors import Fate, record, try_change

SOURCE = '''\
"""Says a + b."""

LEVEL = 3


def larger(a: float, b: float = -1.0) -> float:
    """Return max(a, b) - nothing else."""
    if a < b:
        raise ValueError(f"{a + b} is no größer")
    return max(a, b) if b >= 0 else sum([a, b], start=0.0) + LEVEL


def endless(n: int) -> int:
    while n > 0:
        n -= 1
    return n


def untested(x: float) -> float:
    return x + 1.0
'''
TESTS = """\
from stickslip.deep.inside import endless, larger


def test_larger():
    assert larger(3.0, 2.0) == 3.0


def test_endless():
    assert endless(2) == 0
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A package with a folder in it, its tests, and the plugin."""
    for name, text in (
        ("stickslip/__init__.py", ""),
        ("stickslip/deep/__init__.py", ""),
        ("stickslip/deep/inside.py", SOURCE),
        ("tests/test_inside.py", TESTS),
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    shutil.copy(recording.__file__, tmp_path / "tests")
    return tmp_path


def pick(changes: list[Change], before: str, after: str) -> Change:
    (found,) = (c for c in changes if c.before == before and c.after == after)
    return found


def test_every_kind_of_change_is_found_in_folders_too(project: Path) -> None:
    changes = changes_of(project / "stickslip")
    assert {c.file for c in changes} == {"stickslip/deep/inside.py"}
    assert {c.kind for c in changes} == set(KINDS)
    for kind, before, after in (
        ("comparison", "a < b", "(a <= b)"),
        ("side", "max", "min"),
        ("number", "3", "4"),
        ("term", "sum([a, b], start=0.0) + LEVEL", "sum([a, b], start=0.0)"),
        ("keyword", "sum([a, b], start=0.0)", "sum([a, b])"),
        ("sign", "-1.0", "1.0"),
        ("call", "n -= 1", "pass"),
    ):
        assert pick(changes, before, after).kind == kind
    assert any(c.kind == "branch" and c.line == 10 for c in changes)


def test_changed_source_is_a_program_and_what_is_said_stays(project: Path) -> None:
    source = (project / "stickslip" / "deep" / "inside.py").read_bytes()
    for change in changes_of(project / "stickslip"):
        changed = change.applied(source)
        ast.parse(changed)
        assert changed.count("größer".encode()) == 1
        assert b"Return max(a, b) - nothing else." in changed and b"{a + b}" in changed
        assert source[slice(*change.span)].decode() == change.before


def test_the_same_seed_draws_the_same_changes(project: Path) -> None:
    changes = changes_of(project / "stickslip")
    drawn = sample(changes, 12, 5, project)
    assert drawn == sample(changes, 12, 5, project)
    assert len(drawn) == len(set(drawn)) == 12
    assert drawn != sample(changes, 12, 6, project)
    assert {c.kind for c in sample(changes, len(KINDS), 1, project)} == set(KINDS)


@pytest.mark.slow
def test_changes_are_noticed_survive_or_do_not_end(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = record(project, ["tests"], project / "kept.json")
    assert set(known.seconds) == {"tests/test_inside.py::test_larger", "tests/test_inside.py::test_endless"}
    assert record(project, ["tests"], project / "kept.json") == known
    changes = changes_of(project / "stickslip")
    path = project / "stickslip" / "deep" / "inside.py"
    sound = path.read_bytes()

    noticed = try_change(project, pick(changes, "max", "min"), known, 5.0)
    assert (noticed.fate, noticed.by, noticed.tests) == (
        Fate.NOTICED,
        "tests/test_inside.py::test_larger",
        1,
    )
    survived = try_change(project, pick(changes, "a < b", "(a <= b)"), known, 5.0)
    assert survived.fate == Fate.SURVIVED and survived.survived
    assert str(survived) == (
        f"SURVIVES     stickslip/deep/inside.py:{survived.change.line}  [comparison]  a < b  ->  (a <= b)  (1 tests)"
    )
    # no test calls it: all tests that run its file are taken
    alone = try_change(project, pick(changes, "x + 1.0", "x"), known, 5.0)
    assert alone.fate == Fate.SURVIVED and alone.tests == 2
    monkeypatch.setattr("survivors._STARTUP", 2.0)
    endless = try_change(project, pick(changes, "n -= 1", "pass"), known, 5.0)
    assert endless.fate == Fate.ENDLESS and not endless.survived
    assert path.read_bytes() == sound
