"""Rows over damaged scene files: each ends in a scene or in ValueError or TypeError with a message; no code is run."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from stickslip import Scene
from stickslip.benchmark import flywheel_benchmark
from validation.random_scenes import draw
from validation.rows import Row, Tried, require
from validation.tried import try_each

SEED, PATIENCE = 7, 5.0
QUICK_COUNT, COUNT = 1500, 20_000
WORDS = ("", "x", "ground", "b0", "sine", "PreSlip", "kinetic", "__class__", "1e999", "nan", "\x00", "\u202e")
NUMBERS = (0, 1, -1, 10**400, 0.5, -0.0, 1e308, 5e-324, math.nan, math.inf, -math.inf)
KEYS = ("type", "law", "kinetic", "signal", "terms", "function", "name", "x")


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return all places within plain data."""
    found = [path]
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        found += places(value, (*path, key))
    return found


def put(data: Any, path: tuple[Any, ...], value: Any) -> Any:
    """Return plain data with another value in one place."""
    if not path:
        return value
    data = copy.copy(data)
    data[path[0]] = put(data[path[0]], path[1:], value)
    return data


def at(data: Any, path: tuple[Any, ...]) -> Any:
    """Return what stands in a place."""
    for key in path:
        data = data[key]
    return data


def read(data: Any) -> float:
    """Return 0 where data is read as a scene that can be written and read again, or refused in words."""
    try:
        scene = Scene.from_dict(data)
    except (ValueError, TypeError) as error:
        require(bool(str(error)), "an error without words")
        return 0.0
    require(
        Scene.from_dict(scene.to_dict()) == scene, "the scene that was read is not the one that was written"
    )
    return 0.0


def junk(random: np.random.Generator, depth: int = 0) -> Any:
    """Return plain data of any kind."""
    kind = int(random.integers(7 if depth < 2 else 5))
    if kind >= 5:
        parts = [junk(random, depth + 1) for _ in range(int(random.integers(4)))]
        return parts if kind == 5 else {KEYS[int(random.integers(len(KEYS)))]: part for part in parts}
    return (
        None,
        bool(random.integers(2)),
        NUMBERS[int(random.integers(len(NUMBERS)))],
        WORDS[int(random.integers(len(WORDS)))],
        round(float(random.normal(0, 10)), 3),
    )[kind]


@cache
def sources() -> tuple[Any, ...]:
    """Return good scenes as plain data."""
    scenes = [flywheel_benchmark(), flywheel_benchmark().regularized(1e-3), *(draw(n) for n in range(12))]
    return tuple(json.loads(json.dumps(scene.to_dict())) for scene in scenes)


def damaged(number: int) -> Any:
    """Return a scene file with one or two things changed, left out, added or doubled: the same every time."""
    random = np.random.default_rng([SEED, number])
    data = sources()[number % len(sources())]
    for _ in range(int(random.integers(1, 3))):
        where = places(data)
        path = where[int(random.integers(len(where)))]
        value, how = at(data, path), int(random.integers(4))
        if how == 0 and isinstance(value, dict):
            value = {**value, KEYS[int(random.integers(len(KEYS)))]: junk(random)}
        elif how == 1 and isinstance(value, (dict, list)) and value:
            drop = int(random.integers(len(value)))
            kept = [
                item
                for i, item in enumerate(value.items() if isinstance(value, dict) else value)
                if i != drop
            ]
            value = dict(kept) if isinstance(value, dict) else kept
        elif how == 2 and isinstance(value, list):
            value = value + value
        else:
            value = junk(random)
        data = put(data, path, value)
    return data


def fuzzed(count: int) -> Tried:
    """Read damaged scene files."""
    return try_each(((f"file {n}", partial(_read_number, n)) for n in range(count)), limit=PATIENCE)


def _read_number(number: int) -> float:
    return read(damaged(number))


def harmless() -> Tried:
    """Read scene files with code in every place, one after another; it would leave a file behind."""
    with TemporaryDirectory() as folder:
        mark = Path(folder) / "ran"
        code = f"__import__('pathlib').Path({str(mark)!r}).touch()"

        def items() -> Iterator[tuple[str, Callable[[], float]]]:
            for scene in sources():
                for path in places(scene)[1:]:
                    yield f"code at {path}", partial(_read_code, put(scene, path, code), mark)

        return try_each(items(), limit=PATIENCE)


def _read_code(data: Any, mark: Path) -> float:
    read(data)
    require(not mark.exists(), "code in the file was run")
    return 0.0


def rows(quick: bool) -> list[Row]:
    """Return the rows, over fewer files where it is to be quick."""
    count = QUICK_COUNT if quick else COUNT
    file_row = partial(Row, "Robustness", bound=0.0, limit=300.0, tries="damaged scene files")
    return [
        file_row(
            name="scene-files-damaged",
            what=f"{count} scene files with one or two things changed, left out, added or doubled",
            source="a scene that can be written and read again, or an error in words",
            check=partial(fuzzed, count),
        ),
        file_row(
            name="scene-files-with-code",
            what="scene files with code in one place, any place",
            source="nothing of it is run",
            check=harmless,
        ),
    ]
