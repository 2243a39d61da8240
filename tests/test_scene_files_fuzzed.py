"""Whatever stands in a scene file, reading it ends in a scene or in ValueError or TypeError, and runs no code."""

from __future__ import annotations

import copy
import json
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from references import NAMES, load

from stickslip import Scene

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
CODE = "__import__('pathlib').Path('ran').touch()"


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """All places within plain data."""
    found = [path]
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        found += places(value, (*path, key))
    return found


def put(data: Any, path: tuple[Any, ...], value: Any) -> Any:
    if not path:
        return value
    data = copy.copy(data)
    data[path[0]] = put(data[path[0]], path[1:], value)
    return data


def read(data: Any) -> None:
    try:
        scene = Scene.from_dict(data)
    except (ValueError, TypeError) as error:
        assert str(error)
        return
    assert Scene.from_dict(scene.to_dict()) == scene


SCENES = [json.loads(json.dumps(load(name).scene.to_dict())) for name in NAMES]


@given(PLAIN)
@settings(max_examples=200, deadline=None)
def test_anything(data: Any) -> None:
    read(data)


@given(st.sampled_from(SCENES), st.data())
@settings(max_examples=400, deadline=None)
def test_a_scene_with_one_thing_changed(scene: dict[str, Any], data: st.DataObject) -> None:
    path = data.draw(st.sampled_from(places(scene)))
    read(put(scene, path, data.draw(PLAIN)))


@given(st.sampled_from(SCENES), st.data())
@settings(max_examples=200, deadline=None)
def test_a_scene_with_one_thing_too_many(scene: dict[str, Any], data: st.DataObject) -> None:
    tables = [path for path in places(scene) if isinstance(_at(scene, path), dict)]
    path = data.draw(st.sampled_from(tables))
    key, value = data.draw(st.sampled_from(["kinetic", "type", "law", "function", "x"])), data.draw(PLAIN)
    read(put(scene, path, {**_at(scene, path), key: value}))


def _at(data: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        data = data[key]
    return data


def test_no_code_runs(tmp_path: Any, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    for scene in SCENES:
        for path in places(scene):
            if path:
                read(put(scene, path, CODE))
    assert list(tmp_path.iterdir()) == []
