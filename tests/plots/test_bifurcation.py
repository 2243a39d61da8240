"""Diagrams of branches: where the points stand on the lines."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stickslip.plots.bifurcation import _parts, _write_beside
from stickslip.plots.style import own_axes


def part(values: list[float], points: list[tuple[float, str]], beyond: Any = None) -> Any:
    """Return a branch whose cycles at a value x have the period 10 + x."""
    marks = [
        SimpleNamespace(value=value, kind=kind, cycle=SimpleNamespace(period=10.0 + value)) for value, kind in points
    ]
    periods = 10.0 + np.array(values, dtype=float)
    return SimpleNamespace(
        values=values, periods=periods, stable=np.ones(len(values), dtype=bool), points=marks, beyond=beyond
    )


@pytest.mark.parametrize(
    ("branch", "expected"),
    [
        (part([3.0, 2.0, 1.0], [(2.5, "crossing"), (0.9, "end")]), [[3.0, 2.5, 2.0, 1.0, 0.9]]),
        (
            part([1.0, 2.0], [(1.5, "flip"), (2.2, "fold")], part([2.0], [(1.9, "flip"), (1.8, "end")])),
            [[1.0, 1.5, 2.0, 2.2], [2.2, 2.0, 1.9, 1.8]],
        ),
        (
            part([1.0], [(2.2, "fold")], part([], [(2.1, "flip"), (2.05, "crossing"), (1.8, "end")])),
            [[1.0, 2.2], [2.2, 2.1, 2.05, 1.8]],
        ),
    ],
)
def test_points_stand_in_order_along_each_part(branch: Any, expected: list[list[float]]) -> None:
    parts = _parts(branch, None)
    assert [x.tolist() for x, _, _ in parts] == expected
    for x, y, _ in parts:
        assert y == pytest.approx(10.0 + x)


def test_points_next_to_each_other_share_a_text() -> None:
    ax = own_axes(None, 6.0, 4.0)
    ax.set(xlim=(1.0, 0.0), ylim=(0.0, 10.0))
    first, second = (0.5, 1.0, "first", True, 0.0), (0.51, 1.1, "second", True, 0.0)
    _write_beside(ax, [(0.6, 1.2, "beside", True, 0.0), first, second])
    assert [text.get_text() for text in ax.texts] == ["first\nsecond", "beside"]
    _write_beside(ax, [(0.505, 9.0, "above", True, 0.0), second])
    assert [text.get_text() for text in ax.texts[2:]] == ["above", "second"]
