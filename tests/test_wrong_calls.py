"""Calls as a new user may write them: each is refused by its name, with the value and what to write instead."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Scene,
    continue_cycle,
    fit,
    join,
    load,
    output,
    plots,
    simulate,
    sine,
    step,
    sweep,
    tradeoff,
    velocity,
)

LAW = DryFriction(0.2, 0.1)
SCENE = Scene(Body("b", inertia=1.0, velocity=1.0), Contact("c", "b", GROUND, LAW, normal=10.0))
RESULT = simulate(SCENE, (0.0, 2.0))
JOINED = join([RESULT])
VALUES = [0.0, 1.0]


@pytest.fixture(autouse=True)
def leaves_no_figure() -> Iterator[None]:
    plt.close("all")
    yield
    assert plt.get_fignums() == []


WRONG: list[tuple[Callable[[], Any], str]] = [
    (
        lambda: Body("b", inertia=1.0, motion="spin"),
        "body 'b': motion must be 'rotation' or 'translation', got 'spin'",
    ),
    (lambda: Body("b", inertia=1.0, motion=["rotation"]), "motion must be 'rotation' or 'translation'"),
    (lambda: SCENE.with_laws(3), "with_laws: change must be a function of a law, got 3"),
    (lambda: SCENE.draw(ax=3), "ax must be axes of matplotlib, got 3; plt.subplots() returns"),
    (
        lambda: simulate(SCENE, (0.0, 1.0), dense_output="yes"),
        "dense_output must be True or False, got 'yes'",
    ),
    (
        lambda: sine(1.0, 1.0)(np.zeros(2)),
        "a signal is called with one time in s, which must be a number, got array([0., 0.])",
    ),
    (lambda: step(1.0)("1"), "a signal is called with one time in s, which must be a number, got '1'"),
    # -- reading
    (
        lambda: RESULT([[0.1, 0.2]]),
        "a result is called with times in s, got [[0.1, 0.2]]",
    ),
    (lambda: RESULT("1"), "a result is called with times in s, got '1'"),
    (
        lambda: RESULT.sample("3"),
        "sample: give times or their number, got '3'",
    ),
    (lambda: RESULT.sample(2.5), "sample: give times or their number, got 2.5"),
    (lambda: RESULT.sample(None), "sample: give times or their number, got None"),
    (lambda: RESULT.sample([0.0, "1"]), "must be a sequence of numbers, got [0.0, '1']"),
    (lambda: RESULT.sample([[0.0], [1.0, 2.0]]), "must be a sequence of numbers"),
    (
        lambda: RESULT.fit_for_plot("many"),
        "fit_for_plot: points must be a whole number from 0 on, got 'many'",
    ),
    (lambda: JOINED.fit_for_plot(-3), "fit_for_plot: points must be a whole number from 0 on, got -3"),
    (lambda: JOINED.sample([1.0, 0.0]), "sample: give increasing times"),
    (lambda: JOINED.velocity("q"), "no body is called 'q'; known are 'b', 'ground'"),
    (lambda: JOINED.share("q"), "no contact is called 'q'; known are 'c'"),
    (lambda: JOINED.breakaway("c", 3), "breakaway of contact 'c': direction must be +1 (forward) or -1"),
    (lambda: join(RESULT), "join: results must be a sequence of Result(...), got Result(scene="),
    (lambda: join([SCENE]), "join: expected results of simulate or join, got Scene("),
    # -- writing
    (lambda: RESULT.to_csv(None), "to_csv: path must be a text or a pathlib.Path, got None"),
    (lambda: RESULT.save(3), "save: path must be a text or a pathlib.Path, got 3"),
    (lambda: RESULT.report(3.5), "report: path must be a text or a pathlib.Path, got 3.5"),
    (lambda: RESULT.report("run.html", title=3), "report: title must be a text, got 3"),
    (lambda: output.to_json(RESULT, None), "to_json: path must be a text or a pathlib.Path, got None"),
    (lambda: load(3), "load: path must be a text or a pathlib.Path, got 3"),
    (lambda: load(RESULT), "load: path must be a text or a pathlib.Path, got Result("),
    (lambda: load(__file__), "was not written by stickslip's save"),
    (
        lambda: output.save(SCENE, "run.npz"),
        "save: expected a Result, got Scene; simulate(scene, t_span) returns one",
    ),
    (
        lambda: output.to_csv(SCENE, "run.csv"),
        "columns: expected a Result, got Scene; simulate(scene, t_span) returns one",
    ),
    (lambda: output.to_frame(None), "columns: expected a Result, got NoneType"),
    (lambda: output.column_units("run"), "column_units: expected a Result, got str"),
    # -- drawing
    (lambda: RESULT.plot(bodies="b"), "bodies must be a sequence of names, got 'b'; write ['b']"),
    (lambda: RESULT.plot(bodies=3), "bodies must be a sequence of names, got 3"),
    (lambda: RESULT.plot(contacts="c"), "contacts must be a sequence of names, got 'c'; write ['c']"),
    (lambda: RESULT.plot(t_span=3), "overview: t_span must be a sequence of numbers, got 3"),
    (
        lambda: RESULT.plot(t_span=(2.0, 1.0)),
        "overview: t_span must be two times (start, end), got (2.0, 1.0)",
    ),
    (lambda: RESULT.plot(t_span=(50.0, 60.0)), "overview: t_span (50, 60) s lies outside the times of the result"),
    (lambda: RESULT.plot(axes=3), "overview: 3 panels need as many axes, got 1"),
    (lambda: RESULT.plot(axes=[1, 2, 3]), "ax must be axes of matplotlib, got 1"),
    (lambda: plots.velocities(SCENE), "velocities: expected a Result, got Scene"),
    (lambda: plots.modes("RESULT"), "modes: expected a Result, got str"),
    (lambda: plots.overview(3), "overview: expected a Result, got int"),
    (lambda: plots.energy(SCENE), "energy: expected a Result, got Scene"),
    (lambda: plots.characteristic(None, "c"), "characteristic: expected a Result, got NoneType"),
    (lambda: plots.velocities(RESULT, ax="here"), "ax must be axes of matplotlib, got 'here'"),
    (lambda: plots.velocities(RESULT, "b"), "bodies must be a sequence of names, got 'b'; write ['b']"),
    (lambda: plots.schematic(RESULT), "schematic: expected a Scene, got Result"),
    (lambda: plots.sweep_map(RESULT, "x", "y"), "sweep_map: expected a SweepResult, got Result"),
    (lambda: plots.fit(RESULT), "fit plot: expected a Fit, got Result"),
    (lambda: plots.bifurcation(RESULT), "bifurcation: expected a Branch, got Result"),
    (lambda: plots.work_precision(RESULT), "work_precision plot: expected a WorkPrecision, got Result"),
    # -- studies
    (
        lambda: sweep(lambda a: a, {"b": [1]}),
        "sweep: function must take b by name, but it is declared as (a)",
    ),
    (lambda: tradeoff(SCENE, 4.0), "tradeoff: t_span must be two times (start, end), got 4.0"),
    (
        lambda: tradeoff(SCENE, (1.0, 0.0)),
        "tradeoff: t_span must run forward, got (1, 0); swap the two times",
    ),
    (
        lambda: tradeoff(SCENE, (0.0, 1.0), error=sine(1.0, 1.0)),
        "tradeoff: error must take a result and the reference, but it is declared as (t: 'float')",
    ),
    (
        lambda: continue_cycle(SCENE, "b.inertia", 3),
        "continue_cycle: values must be a sequence of numbers, got 3",
    ),
    (
        lambda: fit(SCENE, ["b.inertia"], {"b.velocity": (VALUES, [0.0, "a"])}),
        "fit: data 'b.velocity': values must be a sequence of numbers, got [0.0, 'a']",
    ),
    (
        lambda: fit(SCENE, ["b.inertia"], {"b.velocity": (VALUES, [0.0])}),
        "fit: data 'b.velocity': times and values must be equally many, got 2 and 1",
    ),
    (
        lambda: fit(SCENE, ["b.inertia"], {"b.velocity": (velocity("b"), VALUES)}),
        "fit: data 'b.velocity': times must be a sequence of numbers, got ",
    ),
]


@pytest.mark.parametrize(("call", "words"), WRONG, ids=[words[:40] for _, words in WRONG])
def test_a_wrong_call_is_refused_in_our_words(
    call: Callable[[], Any], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ValueError, TypeError)) as refused:
        call()
    assert words in str(refused.value)
    assert len(str(refused.value)) < 300
    assert not list(tmp_path.iterdir())  # nothing was written


def test_what_is_nearly_wrong_works() -> None:
    assert RESULT(np.float64(0.5)).shape == (1,)
    assert RESULT.sample(np.array([1, 2])).t.tolist() == [1.0, 2.0]
    assert len(RESULT.plot(bodies=("b",), contacts=[], t_span=[0, 1]).axes) == 1
    plt.close("all")
