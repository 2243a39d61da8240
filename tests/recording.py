"""A pytest plugin that finds out which tests run which lines, and that runs chosen tests in a given order.

With `STICKSLIP_RECORD=FILE` it writes how long each test took and which lines of `STICKSLIP_PACKAGE` it ran;
with `STICKSLIP_TESTS=FILE` it runs the tests listed there, one a line, in that order.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Generator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

_lines: dict[str, set[int]] = {}
"""Lines run, by file; files of others are not followed."""
_tests: dict[str, dict[str, Any]] = {}


def _enter(frame: FrameType, event: str, argument: Any) -> Any:
    """Follow the lines of functions of the package."""
    lines = _lines.get(frame.f_code.co_filename)
    if lines is None:
        return None

    def note(frame: FrameType, event: str, argument: Any) -> Any:
        lines.add(frame.f_lineno)
        return note

    return note


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Run a test with its fixtures, and note which lines it ran."""
    if "STICKSLIP_RECORD" not in os.environ:
        return (yield)
    package = Path(os.environ["STICKSLIP_PACKAGE"])
    if not _lines:
        _lines.update({str(path): set() for path in package.rglob("*.py")})
    for lines in _lines.values():
        lines.clear()
    begun = time.perf_counter()
    former = sys.gettrace()
    sys.settrace(_enter)
    try:
        return (yield)
    finally:
        sys.settrace(former)
        run = {
            Path(name).relative_to(package.parent).as_posix(): sorted(lines) for name, lines in _lines.items() if lines
        }
        _tests[item.nodeid] = {"seconds": time.perf_counter() - begun, "run": run}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the listed tests, in their order."""
    if "STICKSLIP_TESTS" not in os.environ:
        return
    wanted = Path(os.environ["STICKSLIP_TESTS"]).read_text().splitlines()
    place = {name: number for number, name in enumerate(wanted)}
    kept = [item for item in items if item.nodeid in place]
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in place])
    items[:] = sorted(kept, key=lambda item: place[item.nodeid])


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Forget tests that fail on the sound package: they notice nothing."""
    if not report.passed:
        _tests.setdefault(report.nodeid, {})["failed"] = True


def pytest_sessionfinish() -> None:
    """Write what was noted."""
    if "STICKSLIP_RECORD" in os.environ:
        Path(os.environ["STICKSLIP_RECORD"]).write_text(json.dumps(_tests))
