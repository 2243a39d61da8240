"""Whatever stands in a scene file, reading it ends in a scene or in ValueError or TypeError, and runs no code."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip import Scene
from validation.exact import REFERENCES, reference

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
SCENES = [json.loads(json.dumps(reference(name).scene.to_dict())) for name in REFERENCES]


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


def read(data: Any) -> None:
    """Read data as a scene that can be written and read again, or be refused in words."""
    try:
        scene = Scene.from_dict(data)
    except (ValueError, TypeError) as error:
        assert str(error)
        return
    assert Scene.from_dict(scene.to_dict()) == scene


@pytest.mark.slow
@given(PLAIN)
@settings(max_examples=200, deadline=None)
def test_anything(data: Any) -> None:
    read(data)


@pytest.mark.slow
@given(st.sampled_from(SCENES), st.data())
@settings(max_examples=400, deadline=None)
def test_a_scene_with_one_thing_changed(scene: dict[str, Any], data: st.DataObject) -> None:
    path = data.draw(st.sampled_from(places(scene)))
    read(put(scene, path, data.draw(PLAIN)))


@pytest.mark.slow
@given(st.sampled_from(SCENES), st.data())
@settings(max_examples=200, deadline=None)
def test_a_scene_with_one_thing_too_many(scene: dict[str, Any], data: st.DataObject) -> None:
    tables = [path for path in places(scene) if isinstance(at(scene, path), dict)]
    path = data.draw(st.sampled_from(tables))
    key, value = data.draw(st.sampled_from(["kinetic", "type", "law", "function", "x"])), data.draw(PLAIN)
    read(put(scene, path, {**at(scene, path), key: value}))


def test_no_code_runs(tmp_path: Path) -> None:
    """Each place of each scene holds code in turn; if it ran, it would make a file."""
    mark = tmp_path / "ran"
    code = f"__import__('pathlib').Path({str(mark)!r}).touch()"
    for scene in SCENES:
        for path in places(scene)[1:]:
            read(put(scene, path, code))
            assert not mark.exists(), path
