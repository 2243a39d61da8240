"""Runs in a row as one table: even times, and heat counted through all of them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Joined, Result, Scene, join, simulate

SCENE = Scene(
    Body("block", inertia=2.0, velocity=3.0),
    Contact("floor", "block", GROUND, DryFriction(0.2, 0.2), normal=10.0),
    motion="translation",
)


@pytest.fixture(scope="module")
def runs() -> tuple[Result, Joined]:
    whole = simulate(SCENE, (0.0, 4.0))
    first = simulate(SCENE, (0.0, 1.25))
    return whole, join([first, simulate(first.final_scene(), (1.25, 4.0))])


def test_even_times_go_through_all_runs(runs: tuple[Result, Joined]) -> None:
    both = runs[1]
    even = both.sample(401)
    assert even.t.size == 401 and np.allclose(np.diff(even.t), 0.01)
    # 3 m/s less 1 m/s² until rest
    assert np.allclose(even.velocity("block"), np.maximum(3.0 - even.t, 0.0), atol=1e-12)
    assert both.sample([0.5, 1.25, 2.0]).velocity("block") == pytest.approx([2.5, 1.75, 1.0])
    assert both.sample([0.1, 0.2]).velocity("block") == pytest.approx([2.9, 2.8])


def test_the_table_counts_heat_from_the_start_of_the_first_run(
    runs: tuple[Result, Joined], tmp_path: Path
) -> None:
    whole, both = runs
    whole.sample(41).to_csv(tmp_path / "whole.csv")
    both.sample(41).to_csv(tmp_path / "both.csv")
    with (tmp_path / "whole.csv").open() as one, (tmp_path / "both.csv").open() as other:
        expected, found = list(csv.reader(one)), list(csv.reader(other))
    assert found[0] == expected[0] and "heat floor [J]" in found[0]
    place = found[0].index("heat floor [J]")
    # all of 1/2 m v² = 9 J becomes heat, over both runs
    assert float(found[-1][place]) == pytest.approx(9.0, abs=1e-12)
    assert np.allclose(np.array(found[1:], float), np.array(expected[1:], float), atol=1e-9)


def test_times_have_to_increase_and_to_lie_within(runs: tuple[Result, Joined]) -> None:
    both = runs[1]
    with pytest.raises(ValueError, match=r"times must lie in \[0, 4\] s, got 0 to 5"):
        both.sample([0.0, 5.0])
    with pytest.raises(ValueError, match="increasing times"):
        both.sample([2.0, 1.0])
    with pytest.raises(ValueError, match="at least 2 times, got 1"):
        both.sample(1)


def test_it_says_when_its_runs_begin_and_end(runs: tuple[Result, Joined]) -> None:
    text = str(runs[1])
    assert text.startswith("0 to 1.25 s: ") and "\n1.25 to 4 s: " in text
    assert "floor: FORWARD -> STUCK" in text
