"""A pytest plugin that finds out which tests run which functions, and that runs chosen tests in a given order.

With `STICKSLIP_RECORD=FILE` it writes how long each test took and which functions of `STICKSLIP_PACKAGE` it called;
with `STICKSLIP_TESTS=FILE` it runs the tests listed there, one a line, in that order.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Generator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

_seen: set[CodeType] = set()
_tests: dict[str, dict[str, Any]] = {}


def _note(frame: FrameType, event: str, argument: Any) -> None:
    """Note the function that is entered; its lines are not followed."""
    _seen.add(frame.f_code)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Run a test with its fixtures, and note what it called."""
    if "STICKSLIP_RECORD" not in os.environ:
        return (yield)
    _seen.clear()
    begun = time.perf_counter()
    former = sys.gettrace()
    sys.settrace(_note)
    try:
        return (yield)
    finally:
        sys.settrace(former)
        package = Path(os.environ["STICKSLIP_PACKAGE"])
        called: set[tuple[str, int]] = set()
        for code in _seen:
            path = Path(code.co_filename)
            if package in path.parents:
                called.add((path.relative_to(package.parent).as_posix(), code.co_firstlineno))
        seconds = time.perf_counter() - begun
        _tests[item.nodeid] = {"seconds": seconds, "called": sorted(called)}


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
