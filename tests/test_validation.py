"""The validation table: that it passes, that it can fail, and what it leaves behind."""

from __future__ import annotations

import multiprocessing
import os
import pkgutil
import re
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from validation import mutations
from validation.__main__ import main, table
from validation.rows import Row, Tried
from validation.runner import run
from validation.tried import summary, try_each

ROOT = Path(__file__).parents[1]


def row(name: str, check: partial, bound: float = 0.5, limit: float = 30.0) -> Row:
    return Row("Examples", name, "an error of its own making", "nothing", check, bound, limit=limit)


GOOD, BAD = row("good", partial(float, 0.25)), row("bad", partial(float, 1.0))
NOT_A_NUMBER = row("not-a-number", partial(float, "nan"))
RAISES = row("raises", partial(float, "text"))
HANGS = row("hangs", partial(time.sleep, 60.0), limit=0.2)
SHORT = ("two-flywheels/contact-force", "leine-belt/merged")
CRASHES = row("crashes", partial(os._exit, 3))


@pytest.mark.slow
def test_the_quick_run_passes(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VALIDATION_PATIENCE", "100")  # a busy machine is no fault
    # other formulations have tests of their own
    rows = [r for r in table(1, quick=True) if not r.name.endswith(("/merged", "/multiplier"))]
    # nor does every one of many similar rows have to run: `python -m validation --quick` runs all
    rows = rows[::4]
    assert len(rows) > 30
    status = main([], rows)
    assert status == 0, capsys.readouterr().out


@pytest.mark.slow
def test_a_row_runs_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["two-flywheels/contact-force"]) == 0
    out = capsys.readouterr().out
    assert "ok    two-flywheels/contact-force" in out and "1 rows" in out


def test_a_pattern_chooses_rows(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list", "loop-*"]) == 0
    assert len(re.findall("^  loop-", capsys.readouterr().out, re.MULTILINE)) == 4


@pytest.mark.slow
def test_rows_that_nobody_waits_for_end_at_once() -> None:
    endless = row("endless", partial(time.sleep, 1e6), limit=1e6)
    outcomes = run([GOOD, endless, endless], jobs=2)
    assert next(outcomes).passed
    outcomes.close()
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("jobs", ["0", "many"])
def test_a_number_of_jobs_that_is_none_is_refused(jobs: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--jobs", jobs])
    assert f"give a number of rows, 1 or more, got '{jobs}'" in capsys.readouterr().err


def test_an_unknown_row_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["no-such-row"]) == 2
    assert "no-such-row" in capsys.readouterr().err


@pytest.mark.slow
def test_without_mpmath_one_sentence_says_what_to_install(tmp_path: Path) -> None:
    absent = 'raise ModuleNotFoundError("No module named mpmath", name="mpmath")'
    (tmp_path / "mpmath.py").write_text(absent, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    command = [sys.executable, "-m", "validation", "--list"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert 'pip install -e ".[test]"' in done.stderr


@pytest.mark.slow
def test_failing_rows_give_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    failing = [BAD, NOT_A_NUMBER, RAISES]
    assert main([], rows=[GOOD, *failing]) == 1
    out = capsys.readouterr().out
    assert all(f"FAIL  {row.name}" in out for row in failing) and "1 pass, 3 fail" in out


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_rows_that_hang_or_crash_fail_and_the_others_go_on(jobs: int) -> None:
    rows = [HANGS, GOOD, CRASHES, GOOD]
    outcomes = list(run(rows, jobs=jobs))
    assert [o.row for o in outcomes] == rows
    assert [o.passed for o in outcomes] == [False, True, False, True]
    assert "no answer within 0.2 s" in outcomes[0].remark
    assert "code 3" in outcomes[2].remark


def sleeps_or_fails(hangs: bool) -> float:
    if hangs:
        time.sleep(60.0)
    raise ValueError("no")


def tries(*items: partial) -> Tried:
    return try_each(((f"item {i}", item) for i, item in enumerate(items)), limit=0.5)


@pytest.mark.slow
def test_what_is_wrong_or_hangs_among_many_is_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, wrong, hung = partial(float, 0.25), partial(sleeps_or_fails, False), partial(sleeps_or_fails, True)
    some = replace(row("some", partial(tries, good, wrong, hung, wrong)), tries="things")
    all_good = replace(row("all-good", partial(tries, good, good)), tries="things")
    lost = replace(row("lost", partial(time.sleep, 60.0), limit=0.2), tries="others")
    assert main(["--report", str(tmp_path)], rows=[some, all_good, lost]) == 1
    out = capsys.readouterr().out
    assert "things: 6 tried in 6 checks, 2 wrong, 1 hung" in out
    assert "of 4 tried 2 wrong, 1 hung; item 1: ValueError: no" in out
    assert "others: 0 tried in 0 checks, 0 wrong, 1 hung" in out
    text = (tmp_path / "validation.html").read_text(encoding="utf-8")
    assert "What was tried" in text and '<td>Things</td><td class="number">6</td>' in text


@pytest.mark.slow
def test_an_item_over_the_bound_or_not_a_number_is_wrong() -> None:
    big = replace(row("big", partial(tries, partial(float, 1.0))), tries="things")
    odd = replace(row("odd", partial(tries, partial(float, "nan"), partial(float, 0.1))), tries="things")
    outcomes = list(run([big, odd]))
    assert not any(o.passed for o in outcomes)
    assert summary(outcomes) == [("things", 3, 3, 2, 0)]


def test_names_are_unique_and_every_row_says_what_it_is() -> None:
    rows = table()
    assert len({r.name for r in rows}) == len(rows) > 150
    assert all(r.what and r.source and r.bound >= 0 for r in rows)
    assert {r.name for r in table(quick=True)} < {r.name for r in rows}


@pytest.mark.slow
def test_the_report_is_one_page_that_needs_nothing_else(tmp_path: Path) -> None:
    names = ["pulled-block/merged", "coupled-clutches/merged", "rtol-1e-6", "loop-triangle"]
    assert main([*names, "--report", str(tmp_path)]) == 0
    (page,) = tmp_path.iterdir()
    text = page.read_text(encoding="utf-8")
    links = re.findall(r"""(?:src|href)=['"]?([^'">\s]+)|url\(['"]?([^'")]+)""", text)
    assert all("".join(link).startswith("#") for link in links)
    assert not re.search("@import|<link|<script", text)
    assert text.count("<svg") == 2 and "All 4 rows pass" in text
    assert all(f"<code>{name}</code>" in text for name in names)


@pytest.mark.slow
def test_the_report_shows_failures_first(tmp_path: Path) -> None:
    assert main(["--report", str(tmp_path)], rows=[GOOD, BAD, RAISES]) == 1
    text = (tmp_path / "validation.html").read_text(encoding="utf-8")
    assert "2 of 3 rows fail" in text
    assert text.index("What failed") < text.index("<code>bad</code>") < text.index("<code>good</code>")


@pytest.mark.slow
def test_mutations_are_noticed() -> None:
    chosen = [m for m in mutations.MUTATIONS if m.name in ("eq1-sign", "one-by-one")]
    assert len(chosen) == 2
    rows = [r for r in table() if r.name in ("stick-phase/contact-force", "edges/contact-force")]
    assert all(o.passed for o in run(rows))
    assert all(mutations.noticing(mutation, rows) for mutation in chosen)


@pytest.mark.slow
@pytest.mark.parametrize("mutation", mutations.MUTATIONS, ids=lambda mutation: mutation.name)
def test_a_mutation_fits_the_package(mutation: mutations.Mutation, monkeypatch: pytest.MonkeyPatch) -> None:
    # the package still has the names and arguments that the mutation uses: answers may be wrong, or refused
    target = mutation.target.replace(":", ".")
    monkeypatch.setattr(target, mutation.change(pkgutil.resolve_name(mutation.target)))
    watching = [r for r in mutations.watched() if r.name in SHORT]
    assert len(watching) == len(SHORT)
    for each in watching:
        try:
            each.check()
        except (AttributeError, TypeError, NameError):
            raise
        except Exception:
            continue
