import ast
import importlib
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip.studies.work_precision import Setup, WorkPrecision, WorkRow, work_precision

# the function of the same name hides the module
study = importlib.import_module("stickslip.studies.work_precision")


def row(name, median, error, failure=None, family=None):
    nan = math.nan
    return WorkRow(name, family, None, median, median, error, nan, nan, nan, nan, failure)


@pytest.fixture
def axes():
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    yield plt.subplots()[1]
    plt.close("all")


class Clock:
    """A clock that only the setups advance."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(study, "clock", SimpleNamespace(perf_counter=lambda: self.now))

    def setup(self, durations):
        left = list(durations)

        def run():
            self.now += left.pop(0)
            return 0.0

        return run


def test_setups_take_turns_and_warm_up_first():
    calls = []
    judged = []
    table = work_precision(
        {"a": lambda: calls.append("a") or 1.0, "b": lambda: calls.append("b") or 2.0},
        error=lambda result: judged.append(result) or result,
        repeats=3,
        warmup=2,
    )
    assert calls == ["a", "b"] * 5
    assert judged == [1.0, 2.0]
    assert [(r.name, r.error, r.failure) for r in table.rows] == [("a", 1.0, None), ("b", 2.0, None)]


def test_times_are_median_and_minimum_of_the_timed_rounds_only(monkeypatch):
    clock = Clock(monkeypatch)
    table = work_precision(
        {"a": clock.setup([100.0, 3.0, 1.0, 8.0]), "b": clock.setup([200.0, 5.0, 5.0, 4.0])},
        error=lambda result: 0.5,
        repeats=3,
    )
    assert [(r.median, r.fastest) for r in table.rows] == [(3.0, 1.0), (5.0, 4.0)]


def test_work_without_warmup_takes_the_error_of_the_first_run(monkeypatch):
    clock = Clock(monkeypatch)
    table = work_precision({"a": clock.setup([2.0])}, error=lambda result: 1e-3, repeats=1, warmup=0)
    assert (table.rows[0].median, table.rows[0].error) == (2.0, 1e-3)


def test_setup_keeps_family_and_call():
    setups = [Setup("bdf 1e-6", lambda: 0.0, family="bdf", call="solve(rtol=1e-6)")]
    (found,) = work_precision(setups, error=lambda result: 1.0, repeats=1).rows
    assert (found.name, found.family, found.call) == ("bdf 1e-6", "bdf", "solve(rtol=1e-6)")


@pytest.mark.parametrize(
    ("result", "expected"),
    [
        (SimpleNamespace(stats={"steps": 7, "nfev": 9, "nguards": 3}, nfev=1, njev=2), (7, 9, 2, 3)),
        (SimpleNamespace(stats={"steps": np.int64(7), "guard_calls": 4}), (7, None, None, 4)),
        (SimpleNamespace(stats=None, nfev=5, njev=6, steps=lambda: 1), (None, 5, 6, None)),
        (np.zeros(3), (None, None, None, None)),
    ],
)
def test_counters_are_read_from_stats_and_then_from_attributes(result, expected):
    (found,) = work_precision({"a": lambda: result}, error=lambda result: 1.0, repeats=1).rows
    counts = (found.steps, found.nfev, found.njev, found.nguards)
    assert tuple(None if math.isnan(x) else x for x in counts) == expected


def test_failures_are_rows_and_are_not_run_again():
    calls = {"early": 0, "late": 0, "good": 0}

    def early():
        calls["early"] += 1
        raise ValueError("too stiff")

    def late():
        calls["late"] += 1
        if calls["late"] == 3:
            raise ZeroDivisionError("third time")
        return 1.0

    def good():
        calls["good"] += 1
        return 1.0

    table = work_precision({"early": early, "late": late, "good": good}, error=float, repeats=4)
    assert calls == {"early": 1, "late": 3, "good": 5}
    assert [r.failure for r in table.rows] == [
        "ValueError: too stiff",
        "ZeroDivisionError: third time",
        None,
    ]
    assert math.isnan(table.rows[1].median)
    assert [r.name for r in table.pareto()] == ["good"]


@pytest.mark.parametrize(
    ("result", "error", "message"),
    [
        (0, lambda r: math.nan, "error is not finite: nan"),
        (0, lambda r: math.inf, "error is not finite: inf"),
        (0, lambda r: -1.0, "error is negative: -1; let the error function return a norm"),
        (0, lambda r: r["x"], "TypeError: 'int' object is not subscriptable"),
        (
            SimpleNamespace(success=False, message="step too small"),
            lambda r: 1.0,
            "not successful: step too small",
        ),
    ],
)
def test_results_without_a_valid_error_are_marked(result, error, message):
    (found,) = work_precision({"a": lambda: result}, error=error, repeats=1).rows
    assert found.failure == message
    assert math.isnan(found.median)


def test_keyboard_interrupt_passes():
    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work_precision({"a": interrupted}, error=float)


@pytest.mark.parametrize(
    ("setups", "options", "kind", "message"),
    [
        ({}, {}, ValueError, "setups is empty; give at least one"),
        ({"a": 3}, {}, TypeError, "'a': run must be a callable without arguments, got 3"),
        ({3: print}, {}, TypeError, r"Setup: name must be a name \(a string that is not empty\), got 3"),
        ({"": print}, {}, TypeError, "a string that is not empty"),
        (7, {}, TypeError, "got 7"),
        ([print], {}, TypeError, r"write Setup\(name, run\)"),
        ([Setup("a", print), Setup("a", print)], {}, ValueError, "two setups are named 'a'; rename one"),
        ({"a": print}, {"error": None}, TypeError, "error must be a callable that takes a result, got None"),
        ({"a": print}, {"repeats": 0}, ValueError, "repeats must be a whole number from 1 on, got 0"),
        ({"a": print}, {"repeats": 1.5}, TypeError, "repeats must be a whole number from 1 on, got 1.5"),
        ({"a": print}, {"warmup": -1}, ValueError, "warmup must be a whole number from 0 on, got -1"),
    ],
)
def test_bad_arguments_are_refused_before_anything_runs(setups, options, kind, message):
    with pytest.raises(kind, match=message):
        work_precision(setups, **{"error": float, **options})


numbers = st.floats(1e-9, 1e3)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=12))
def test_pareto_front_holds_what_nothing_beats(points):
    table = WorkPrecision(tuple(row(str(k), t, e) for k, (t, e) in enumerate(points)))
    front = table.pareto()
    assert front
    for r in table.rows:
        beaten = any(
            o.median <= r.median and o.error <= r.error and (o.median, o.error) != (r.median, r.error)
            for o in table.rows
        )
        assert (r in front) is not beaten
    assert [r.median for r in front] == sorted(r.median for r in front)
    assert [r.error for r in front] == sorted((r.error for r in front), reverse=True)


def test_best_is_the_cheapest_within_an_error_or_the_most_accurate_within_a_time():
    table = WorkPrecision(
        (row("rough", 1.0, 1e-2), row("mid", 2.0, 1e-4), row("bad", 3.0, 1e-3), row("fine", 9.0, 1e-8))
    )
    assert table.best(error=1e-3).name == "mid"
    assert table.best(error=1e-2).name == "rough"
    assert table.best(time=8.0).name == "mid"
    assert table.best(time=100.0).name == "fine"
    with pytest.raises(ValueError, match=r"no setup has error <= 1e-09; the nearest is 'fine' .* tighter"):
        table.best(error=1e-9)
    with pytest.raises(ValueError, match=r"no setup has median time <= 0.5 s; the nearest is 'rough' .* looser"):
        table.best(time=0.5)
    with pytest.raises(TypeError, match="either error= or time="):
        table.best()
    with pytest.raises(TypeError, match="either error= or time="):
        table.best(error=1.0, time=1.0)


def test_best_without_any_success_points_to_the_failures():
    with pytest.raises(ValueError, match=r"no setup succeeded.*failures"):
        WorkPrecision((row("a", math.nan, math.nan, "ValueError: no"),)).best(error=1.0)


def test_table_is_aligned_and_names_failures():
    table = WorkPrecision(
        (
            row("short", 0.5, 1e-3),
            row("a longer name", 2.0, 1e-2),
            row("broken", math.nan, math.nan, "ValueError: line one\nline two"),
        )
    )
    lines = str(table).splitlines()
    assert lines[0].split() == ["setup", "median", "/", "s", "min", "/", "s", "error"]
    assert lines[1].split() == ["*", "short", "0.5", "0.5", "0.001"]
    assert lines[2].split() == ["a", "longer", "name", "2", "2", "0.01"]
    assert len(lines[0]) == len(lines[1]) == len(lines[2])
    assert lines[3].endswith("FAILED ValueError: line one")
    assert "line two" not in str(table)


@pytest.mark.slow
def test_frame_has_one_line_per_row():
    pytest.importorskip("pandas")
    frame = WorkPrecision((row("a", 1.0, 1e-3), row("b", 2.0, 1e-4))).to_frame()
    assert list(frame["name"]) == ["a", "b"]
    assert list(frame["median"]) == [1.0, 2.0]


def test_frame_without_pandas_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"stickslip\[frames\]"):
        WorkPrecision(()).to_frame()


def test_progress_bar_only_on_request(capsys):
    work_precision({"a": lambda: 1.0}, error=float, repeats=2)
    assert capsys.readouterr().err == ""
    work_precision({"a": lambda: 1.0}, error=float, repeats=2, progress=True)
    assert "3/3" in capsys.readouterr().err


@pytest.mark.parametrize("module", ["work_precision", "table", "sweeps", "sweep_data"])
def test_studies_know_no_friction_and_draw_nothing_on_import(module):
    source = Path(study.__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    tree = ast.parse(source)
    outer = [n for n in tree.body if isinstance(n, ast.Import | ast.ImportFrom)]
    names = {a.name for n in outer if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module for n in outer if isinstance(n, ast.ImportFrom)}
    names -= {"stickslip.studies.table", "stickslip.studies.sweep_data", "stickslip.model.checks"}
    assert {name.split(".")[0] for name in names} <= {"numpy", "tqdm", *sys.stdlib_module_names}
    inner = [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module == "stickslip"]
    assert all([a.name for a in n.names] == ["plots"] for n in inner)


def test_plot_has_a_marker_and_a_line_per_family_and_marks_the_front(axes):
    from stickslip.plots import work_precision as draw

    table = WorkPrecision(
        (
            row("bdf 1e-3", 1.0, 1e-2, family="bdf"),
            row("bdf 1e-6", 4.0, 1e-5, family="bdf"),
            row("bdf 1e-4", 4.5, 1e-3, family="bdf"),
            row("rk4 fine", 9.0, 1e-4, family="rk4"),
            row("rk4 coarse", 2.0, 1e-1, family="rk4"),
            row("exact", 5.0, 0.0),
            row("broken", math.nan, math.nan, "ValueError: too stiff\nmore"),
        ),
        error_label="speed error / (rad/s)",
    )
    assert draw(table, ax=axes) is axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert axes.get_xlabel() == "median wall time [s]"
    assert axes.get_ylabel() == "speed error / (rad/s)"
    bdf_rows, bdf_best, bdf, _, rk4_best, rk4 = axes.get_lines()
    assert bdf_rows.get_linestyle() == "None"
    assert list(bdf_rows.get_xdata()) == [1.0, 4.0, 4.5]
    assert list(bdf_best.get_xdata()) == [1.0, 4.0]  # the third only says that the clock is noisy
    assert list(rk4_best.get_ydata()) == [1e-1, 1e-4]
    assert [line.get_label() for line in (bdf, rk4)] == ["bdf", "rk4"]
    assert bdf.get_marker() != rk4.get_marker()
    assert bdf.get_linestyle() != rk4.get_linestyle()
    (front,) = axes.collections
    assert front.get_offsets().tolist() == [[1.0, 1e-2], [4.0, 1e-5]]
    (note,) = axes.texts
    assert note.get_text() == "not drawn:\nexact: error 0 in 5 s\nbroken: ValueError: too stiff"
    axes.figure.canvas.draw()


def test_long_notes_end_before_a_legend_beside_the_axes():
    from stickslip.plots import work_precision as draw

    families = [row(f"method {i}", 1.0 + i, 10.0**-i, family=f"family {i}") for i in range(9)]
    failed = row("simulate(scene)", math.nan, math.nan, 12 * "the step is too long ")
    ax = draw(WorkPrecision((*families, failed), error_label="error"))
    figure, (note,) = ax.figure, ax.texts
    figure.canvas.draw()
    assert note.get_text().endswith(" …")
    assert note.get_window_extent().x1 < ax.get_legend().get_window_extent().x0


def test_plot_of_nothing_but_failures_is_an_empty_frame_with_a_note(axes):
    from stickslip.plots import work_precision as draw

    draw(WorkPrecision((row("a", math.nan, math.nan, "ValueError: no"),)), ax=axes)
    assert not axes.get_lines()
    assert "a: ValueError: no" in axes.texts[0].get_text()
    with pytest.raises(TypeError, match="expected a WorkPrecision, got int"):
        draw(3)


def test_plot_method_goes_through_the_plots_module(monkeypatch, axes):
    import stickslip

    fake = SimpleNamespace(work_precision=lambda table, ax: (table, ax))
    monkeypatch.setattr(stickslip, "plots", fake, raising=False)
    table = WorkPrecision((row("a", 1.0, 1.0),))
    assert table.plot(axes) == (table, axes)
