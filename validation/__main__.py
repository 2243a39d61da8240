"""`python -m validation`: every answer of the package against one that owes it nothing, as a table that can fail."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from tqdm import tqdm

try:
    from validation import (
        against_oracles,
        analysis,
        between,
        conservation,
        crowds,
        edges,
        endurance,
        engines,
        exact,
        impacts,
        magnitudes,
        part_by_part,
        promises,
        published,
        random_scenes,
        rough,
    )
except ModuleNotFoundError as missing:
    if missing.name != "mpmath":
        raise
    needs = 'python -m validation needs mpmath, which comes with the extra [test]: pip install -e ".[test]"'
    print(needs, file=sys.stderr)
    raise SystemExit(2) from None
from validation.report import number, write
from validation.rows import Outcome, Row
from validation.runner import run
from validation.tried import summary

QUICK_SCENES, QUICK_MULTIPLIED, SCENES = 16, 6, 500
QUICK_RUNS = 2  # random runs of each family that is read off between its computed points

# Scenes of each family against the oracle; in proportion where another number of random scenes is asked for.
QUICK_FAMILY, FAMILY = 2, 100


def table(scenes: int = SCENES, quick: bool = False) -> list[Row]:
    """Return the rows, chapter by chapter."""
    family = QUICK_FAMILY if quick else max(1, scenes * FAMILY // SCENES)
    rows = [
        *exact.ROWS,
        *published.ROWS,
        *conservation.ROWS,
        *magnitudes.ROWS,
        *crowds.ROWS,
        *between.rows(QUICK_RUNS if quick else between.RUNS),
        *edges.ROWS,
        *endurance.ROWS,
        *analysis.rows(analysis.QUICK_SCENES if quick else range(family)),
        *engines.rows(family if quick else scenes, quick),
        *part_by_part.rows(family),
        *promises.ROWS,
        *rough.rows(max(1, family // 5)),
        *random_scenes.rows(scenes, min(scenes, QUICK_MULTIPLIED) if quick else scenes),
        *against_oracles.rows(min(scenes, family)),
        *impacts.rows(2 * scenes),
    ]
    return [row for row in rows if row.quick or not quick]


def main(arguments: Sequence[str] | None = None, rows: Sequence[Row] | None = None) -> int:
    """Run the table, or other `rows`; return 1 if a row fails, 2 where there is nothing to run."""
    options = _parser().parse_args(arguments)
    scenes = options.scenes or (QUICK_SCENES if options.quick else SCENES)
    if rows is None:
        rows = table(scenes, quick=options.quick and not options.names)
    if options.names:
        unknown = [n for n in options.names if not any(fnmatchcase(row.name, n) for row in rows)]
        if unknown:
            print(f"no row is called {', '.join(unknown)}; --list shows all", file=sys.stderr)
            return 2
        rows = [row for row in rows if any(fnmatchcase(row.name, name) for name in options.names)]
    if options.list:
        _list(rows)
        return 0
    start = time.perf_counter()
    outcomes = _run(rows, options.jobs)
    failed = [o for o in outcomes if not o.passed]
    spent = time.perf_counter() - start
    print(f"\n{len(outcomes)} rows in {spent:.0f} s: {len(outcomes) - len(failed)} pass, {len(failed)} fail")
    for kind, count, checks, wrong, hung in summary(outcomes):
        print(f"  {kind}: {count} tried in {checks} checks, {wrong} wrong, {hung} hung")
    for outcome in failed:
        print(f"  {outcome.row.name}: {_why(outcome)}")
    if options.report is not None:
        command = " ".join(["python -m validation", *(["--quick"] if options.quick else []), *options.names])
        print(f"report: {write(outcomes, options.report, command, spent)}")
    return 1 if failed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m validation", description=__doc__)
    parser.add_argument("names", nargs="*", help="rows to run, by name or pattern such as 'chain-*'; all by default")
    parser.add_argument("--quick", action="store_true", help="leave out what is long; under a minute")
    parser.add_argument("--list", action="store_true", help="show the rows and end")
    parser.add_argument(
        "--scenes",
        type=int,
        metavar="N",
        help=f"number of random scenes ({SCENES}, quick {QUICK_SCENES}); a fifth as many in each family of the oracle "
        "and with derivatives",
    )
    parser.add_argument(
        "--jobs",
        type=_jobs,
        default=1,
        metavar="N",
        help="number of rows that run side by side (1); one for each core at most, or times mean less",
    )
    parser.add_argument("--report", type=Path, metavar="DIR", help="write a page with tables and figures into DIR")
    return parser


def _jobs(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"give a number of rows, 1 or more, got {text!r}")
    return int(text)


def _list(rows: Sequence[Row]) -> None:
    theme = ""
    for row in rows:
        if row.theme != theme:
            theme = row.theme
            print(f"\n{theme}")
        print(f"  {row.name:42s} {row.what}")


def _run(rows: Sequence[Row], jobs: int) -> list[Outcome]:
    outcomes: list[Outcome] = []
    theme = ""
    with tqdm(total=len(rows), unit="row", file=sys.stderr, leave=False, dynamic_ncols=True) as bar:
        for outcome in run(rows, jobs=jobs):
            if outcome.row.theme != theme:
                theme = outcome.row.theme
                bar.write(f"\n{theme:50s} {'error':>9s}    {'bound':>7s} {'time':>8s}", file=sys.stdout)
            bar.write(_line(outcome), file=sys.stdout)
            bar.update()
            outcomes.append(outcome)
    return outcomes


def _line(outcome: Outcome) -> str:
    row, mark = outcome.row, "ok  " if outcome.passed else "FAIL"
    sign = "<=" if outcome.passed else "> "
    line = f"{mark}  {row.name:44s} {number(outcome.error):>9s} {sign} {number(row.bound):>7s} {outcome.seconds:7.2f} s"
    return line if outcome.passed else f"{line}\n      {_why(outcome)}"


def _why(outcome: Outcome) -> str:
    return outcome.remark or f"error {number(outcome.error)}, at most {number(outcome.row.bound)}: {outcome.row.what}"


if __name__ == "__main__":
    sys.exit(main())
