"""How much the files of the package talk to each other: calls from one file to another, and the way of one guard value.

Run as ``python -m benchmarks.calls``. The numbers depend on the code alone, not on the machine.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any
from unittest import mock

import stickslip
from benchmarks.tradeoff import leines_belt
from stickslip import simulate
from stickslip.benchmark import BENCHMARK_SPAN, flywheel_benchmark
from stickslip.equations.guards.guards import Guards

PACKAGE = str(Path(stickslip.__file__).parent)
SHOWN = 8

Call = tuple[str, str, str]  # the calling file, the called file, and the name of the called function


def calls(run: Callable[[], Any]) -> Counter[Call]:
    """Return how often each function of the package is called by another one while something runs."""
    found: Counter[Call] = Counter()

    def note(frame: FrameType, event: str, _: Any) -> None:
        caller = frame.f_back
        if event != "call" or caller is None:
            return
        here, there = frame.f_code.co_filename, caller.f_code.co_filename
        if here.startswith(PACKAGE) and there.startswith(PACKAGE):
            found[_name(there), _name(here), frame.f_code.co_qualname] += 1

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    return found


def _name(file: str) -> str:
    return file.removeprefix(PACKAGE + "/").removesuffix(".py")


def between_files(found: Counter[Call]) -> Counter[tuple[str, str]]:
    """Return the calls that go from one file to another."""
    total: Counter[tuple[str, str]] = Counter()
    for (there, here, _), count in found.items():
        if there != here:
            total[there, here] += count
    return total


def way_of_a_guard(run: Callable[[], Any]) -> tuple[set[str], set[str]]:
    """Return the files and the functions that take part in one call of `Guards.smallest`: the longest of all calls."""
    ways: list[Counter[Call]] = []
    original = Guards.smallest

    def watched(self: Guards, *arguments: Any) -> float:
        answer: list[float] = []
        ways.append(calls(lambda: answer.append(original(self, *arguments))))
        return answer[0]

    with mock.patch.object(Guards, "smallest", watched):
        run()
    longest = max(ways, key=len)
    files = {file for there, here, _ in longest for file in (there, here)}
    return files, {f"{here}:{name}" for _, here, name in longest} | {"equations/guards/guards:Guards.smallest"}


def main() -> None:
    """Print the counts."""
    runs: dict[str, Callable[[], Any]] = {
        "benchmark, Taylor series": lambda: simulate(flywheel_benchmark(), BENCHMARK_SPAN),
        "benchmark, CVODE BDF": lambda: simulate(flywheel_benchmark(), BENCHMARK_SPAN, method="BDF"),
        "Leine's belt": lambda: simulate(leines_belt(), (0.0, 40.0)),
    }
    for name, run in runs.items():
        run()
        found = calls(run)
        between = between_files(found)
        print(f"{name}: {sum(found.values())} calls, {sum(between.values())} from file to file")
        for (there, here), count in between.most_common(SHOWN):
            print(f"{count:8d}  {there} -> {here}")
    files, functions = way_of_a_guard(runs["Leine's belt"])
    print(f"one guard value in Leine's belt visits {len(files)} files: {', '.join(sorted(files))}")
    print(f"and {len(functions)} functions: {', '.join(sorted(functions))}")
    lines = [len(path.read_text(encoding="utf-8").splitlines()) for path in Path(PACKAGE).rglob("*.py")]
    print(f"the package: {len(lines)} files, {sum(lines)} lines")


if __name__ == "__main__":
    main()
