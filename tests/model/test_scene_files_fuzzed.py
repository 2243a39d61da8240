"""Whatever stands in a scene file, reading it ends in a scene or in ValueError or TypeError, and runs no code."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from references import NAMES, load

from validation.scene_files import at, harmless, places, put, read

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
SCENES = [json.loads(json.dumps(load(name).scene.to_dict())) for name in NAMES]


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


def test_no_code_runs() -> None:
    tried = harmless()
    assert tried.count > 300 and tried.error == 0.0, tried.remark
