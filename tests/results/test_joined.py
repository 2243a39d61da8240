"""Runs in a row as one table: even times, and heat counted through all of them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip
from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Joined,
    LuGre,
    Mode,
    Result,
    Scene,
    Spring,
    join,
    output,
    signal,
    simulate,
)
from stickslip.benchmark import BENCHMARK_SPAN, EXACT_EVENTS, flywheel_benchmark

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


def test_the_table_counts_heat_from_the_start_of_the_first_run(runs: tuple[Result, Joined], tmp_path: Path) -> None:
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
    with pytest.raises(ValueError, match="number of times must be a whole number from 2 on, got 1"):
        both.sample(1)


def test_it_says_when_its_runs_begin_and_end(runs: tuple[Result, Joined]) -> None:
    text = str(runs[1])
    assert text.startswith("0 to 1.25 s: ") and "\n1.25 to 4 s: " in text
    assert "floor: FORWARD -> STUCK" in text


OLD, NEW = (
    Scene(
        Body("wheel", inertia=inertia, velocity=speed, motion="rotation"),
        *more,
        Contact("brake", "wheel", GROUND, DryFriction(0.5, 0.5), normal=2.0),
    )
    for inertia, speed, more in (
        (1.0, 4.0, [Body("lost", inertia=1.0, velocity=1.0, motion="translation")]),
        (2.0, 3.0, [Contact("second", "wheel", GROUND, DryFriction(0.25, 0.25), normal=2.0)]),
    )
)
"""First 1 N m slows 1 kg m² from 4 to 3 rad/s in 1 s; then 1.5 N m slow 2 kg m² from 3 rad/s to rest in 4 s."""


@pytest.fixture(scope="module")
def changed() -> Joined:
    return join([simulate(OLD, (0.0, 1.0)), simulate(NEW, (1.0, 6.0))])


def test_energy_is_counted_through_runs_of_different_scenes(changed: Joined) -> None:
    ledger = changed.sample([0.0, 1.0, 5.0, 6.0]).energy()
    # 1/2 v² = 8 J and 0.5 J; 3.5 J go into the brake; at 3 rad/s the wheel gains 4.5 J, and the lost body takes 0.5 J
    assert ledger.kinetic == pytest.approx([8.5, 9.0, 0.0, 0.0])
    assert ledger.changes == pytest.approx([0.0, 4.0, 4.0, 4.0])
    # then 1 N m and 0.5 N m over 6 rad
    assert ledger.contacts["brake"] == pytest.approx([0.0, 3.5, 9.5, 9.5])
    assert ledger.contacts["second"] == pytest.approx([0.0, 0.0, 3.0, 3.0])
    assert ledger.relative_error < 1e-14
    assert "changes between runs       4" in str(ledger)


def test_shares_count_the_runs_that_know_the_contact(changed: Joined) -> None:
    assert changed.share("brake") == pytest.approx({-1: 0.0, 0: 1 / 6, 1: 5 / 6})
    assert changed.share("second") == pytest.approx({-1: 0.0, 0: 1 / 5, 1: 4 / 5})
    with pytest.raises(ValueError, match="no contact is called 'third'"):
        changed.share("third")


def test_everything_by_name_is_read_through_all_runs(changed: Joined) -> None:
    even = changed.sample([0.5, 3.0])
    assert even.velocity("wheel") == pytest.approx([3.5, 1.5])
    assert even.breakaway("brake") == pytest.approx([1.0, 1.0])
    assert np.isnan(even.force("second")[0]) and even.force("second")[1] == pytest.approx(0.5)
    assert np.isnan(even.velocity("lost")[1])
    assert even.stretch("brake")[0] == pytest.approx(0.5 * (4.0 + 3.5) * 0.5)
    assert even.mode("brake").tolist() == [1, 1]
    with pytest.raises(ValueError, match="no body is called 'wheels'"):
        even.velocity("wheels")


@pytest.mark.slow
def test_it_draws_and_tells_all_runs(changed: Joined, tmp_path: Path) -> None:
    assert [body.name for body in changed.scene.bodies] == ["wheel", "lost"]
    assert changed.scene.bodies[0].inertia == 2.0
    figure = changed.plot()
    assert [ax.get_ylabel() for ax in figure.axes[:2]] == ["velocity [rad/s]", "velocity [m/s]"]
    told = changed.explain()
    assert told.startswith("From 0 s to 1 s\nScene: 2 bodies") and "\n\nFrom 1 s to 6 s\nScene: 1 body" in told
    changed.report(tmp_path / "both.html")
    page = (tmp_path / "both.html").read_text(encoding="utf-8")
    for words in (
        "<h3>From 0 s to 1 s</h3>",
        "<h3>From 1 s to 6 s</h3>",
        "changes between runs",
        "heat of second",
    ):
        assert words in page
    assert "<td>second</td>" in changed._repr_html_()


def test_a_block_may_have_other_states_in_another_run() -> None:
    def counting(count: int) -> Block:
        given: dict[str, Any] = {"derivative": lambda t, x, u: [1.0] * count, "output": lambda t, x, u: x}
        return Block("clock", states=[0.0] * count, **given)

    body = Body("wheel", inertia=1.0)
    both = join([simulate(Scene(body, counting(k)), (k - 1.0, float(k)), t_eval=[float(k)]) for k in (1, 2)])
    found = both.state("clock")
    assert found.shape == (2, 2) and np.isnan(found[1, 0]) and found[0] == pytest.approx([1.0, 1.0])
    assert [ax.get_ylabel() for ax in both.plot().axes] == ["velocity [m/s | rad/s]", "clock"]


@pytest.mark.parametrize("number", range(5))
def test_an_event_at_which_a_run_ends_is_noted_where_it_joins_the_next(number: int) -> None:
    """The flywheel benchmark, cut at its events: the story is that of the whole, each event once."""
    scene = flywheel_benchmark()
    cut = EXACT_EVENTS[number].t
    first = simulate(scene, (0.0, cut))
    both = join([first, simulate(first.final_scene(), (cut, BENCHMARK_SPAN[1]))])
    assert [(e.contact, e.before, e.after) for e in both.events] == [
        (e.contact, e.before, e.after) for e in EXACT_EVENTS
    ]
    np.testing.assert_allclose([e.t for e in both.events], [e.t for e in EXACT_EVENTS], rtol=0, atol=1e-12)


def test_a_block_that_a_cut_finds_at_rest_is_at_rest_from_then_on() -> None:
    # 3 m/s less 1 m/s^2: at rest at 3 s, and but for roundoff there
    first = simulate(SCENE, (0.0, 3.0))
    second = simulate(first.final_scene(), (3.0, 4.0))
    assert first.final_scene().bodies[0].velocity == 0.0
    assert not second.events and second.mode("floor")[-1] == Mode.STUCK
    (event,) = join([first, second]).events
    assert (event.t, event.before, event.after) == (3.0, Mode.FORWARD, Mode.STUCK)
    assert event.cause in {"between two runs", "relative velocity 0"}


def test_another_law_in_the_next_run_may_change_a_mode() -> None:
    # held by 0.2 * 10 N against 1 N, let go by 0.05 * 10 N
    pulled = Scene(*SCENE.elements[1:], Body("block", inertia=2.0), Force("block", 1.0))
    first = simulate(pulled, (0.0, 1.0))
    second = simulate(first.final_scene().replace("floor", law=DryFriction(0.05, 0.05)), (1.0, 2.0))
    (event,) = join([first, second]).events
    assert (event.t, event.before, event.after, event.cause) == (
        1.0,
        Mode.STUCK,
        Mode.FORWARD,
        "between two runs",
    )
    assert second.velocity("block")[-1] == pytest.approx(0.25, abs=1e-12)


def test_a_file_brings_all_runs_back(changed: Joined, tmp_path: Path) -> None:
    changed.save(tmp_path / "runs.npz")
    again = stickslip.load(tmp_path / "runs.npz")
    assert isinstance(again, Joined)
    assert [run.scene for run in again.runs] == [run.scene for run in changed.runs]
    assert again.events == changed.events and str(again) == str(changed)
    assert again.explain() == changed.explain() and str(again.energy()) == str(changed.energy())
    for one in (changed, changed.sample(21)):
        same = again if one is changed else again.sample(21)
        found, expected = output.columns(same), output.columns(one)
        assert list(found) == list(expected)
        assert all(np.array_equal(found[name], expected[name], equal_nan=True) for name in expected)


def test_one_run_in_a_row_stays_one(runs: tuple[Result, Joined], tmp_path: Path) -> None:
    join([runs[0]]).save(tmp_path / "one.npz")
    again = stickslip.load(tmp_path / "one.npz")
    assert isinstance(again, Joined) and again.events == runs[0].events


def test_scenes_made_of_code_are_given_for_each_run(tmp_path: Path) -> None:
    first = Scene(Body("a", inertia=1.0), Force("a", signal(lambda t: t * t, period=1.0)))
    one = simulate(first, (0.0, 1.0))
    second = one.final_scene()
    both = join([one, simulate(second, (1.0, 2.0))])
    both.save(tmp_path / "runs.npz")
    with pytest.raises(ValueError, match="holds code"):
        stickslip.load(tmp_path / "runs.npz")
    with pytest.raises(ValueError, match="holds 2 runs in a row; give the scene of each, got 1"):
        stickslip.load(tmp_path / "runs.npz", [first])
    again = stickslip.load(tmp_path / "runs.npz", [first, second])
    assert np.array_equal(again.position("a"), both.position("a"))


def test_runs_of_which_too_little_was_kept_are_refused(runs: tuple[Result, Joined]) -> None:
    first, second = runs[1].results
    nothing = simulate(first.final_scene(), (1.25, 4.0), t_eval=[], dense_output=False)
    for some in ([first, nothing], [nothing, second], [nothing]):
        number = some.index(nothing) + 1
        with pytest.raises(ValueError, match=f"of run {number} nothing was computed, or nothing was kept"):
            join(some)
    late = simulate(first.final_scene(), (1.25, 4.0), t_eval=[3.5], dense_output=False)
    with pytest.raises(ValueError, match="what lies between was not kept: simulate with dense_output=True"):
        join([first, late])


def test_runs_that_are_joined_already_can_be_joined_again(runs: tuple[Result, Joined]) -> None:
    _, whole = runs
    first, *rest = whole.results
    again = join([join([first]), *rest])
    assert again.results == whole.results
    np.testing.assert_array_equal(again.t, whole.t)
    with pytest.raises(TypeError, match="expected results of simulate or join, got 3"):
        join([first, 3])  # type: ignore[list-item]


def test_a_plain_restart_changes_no_energy() -> None:
    """Roundoff of the energies at both sides of the restart is no change."""
    scene = Scene(
        Body("a", inertia=1.3, position=0.1),
        Drive("belt", velocity=0.3),
        Contact("rub", "a", "belt", LuGre(DryFriction(0.3, 0.2), stiffness=1e4, damping=10.0), normal=7.0),
        Spring("a", GROUND, stiffness=50.0, rest=0.07),
    )
    runs = [simulate(scene, (0.0, 0.7))]
    for start in (0.7, 1.4, 2.1):
        runs.append(simulate(runs[-1].final_scene(), (start, start + 0.7)))
    ledger = join(runs).energy()
    assert np.all(ledger.changes == 0.0)
    assert "changes between runs" not in str(ledger)
    assert "changes between runs" not in output.columns(join(runs))


def test_explain_tells_of_changes_between_runs() -> None:
    """A load that only the second run has tears a stuck block loose."""
    block = (Body("a", inertia=1.0), Contact("rub", "a", GROUND, DryFriction(0.3, 0.2), normal=10.0))
    first = simulate(Scene(*block), (0.0, 2.0))
    second = simulate(Scene(*first.final_scene().elements, Force("a", 5.0)), (2.0, 3.0))
    both = join([first, second])
    (event,) = both.events
    assert event.cause == "between two runs"
    head, tail = both.explain().split("From 2 s to 3 s\n")
    assert "Changes from the run before" not in head
    assert tail.startswith(f"Changes from the run before:\n  {event}\n")
