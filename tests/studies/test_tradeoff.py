import ast
import dataclasses
import importlib
import math
import re
import warnings

import numpy as np
import pytest
from clocks import count_work

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Karnopp,
    Scene,
    SimulationError,
    SimulationInterrupted,
    Spring,
    simulate,
    sine,
)
from stickslip.benchmark import BENCHMARK_SPAN, EXACT_FINAL_VELOCITY, flywheel_benchmark
from stickslip.model.laws import PreSlip
from stickslip.studies.tradeoff import Advice, Skipped, Tradeoff, _velocity_error, tradeoff
from stickslip.studies.tradeoff_setups import Call, calls, reference_calls
from stickslip.studies.work_precision import WorkPrecision, WorkRow

module = importlib.import_module("stickslip.studies.tradeoff")


@pytest.fixture(scope="module")
def benchmark():
    with pytest.MonkeyPatch.context() as patch:
        count_work(patch)
        return tradeoff(flywheel_benchmark(), BENCHMARK_SPAN, budget=2.0)


@pytest.fixture
def axes():
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    yield plt.subplots()[1]
    plt.close("all")


def row(name, median, error, failure=None):
    nan = math.nan
    return WorkRow(name, "kind", name, median, median, error, nan, nan, nan, nan, failure)


def made(*rows, limit=1e-12, skipped=()):
    return Tradeoff(WorkPrecision(tuple(rows)), limit, "simulate(scene, a)", "simulate(scene, b)", skipped)


def sliding_block(law=None, **spring):
    springs = [Spring("block", GROUND, **spring)] if spring else []
    law = DryFriction(0.2, 0.1) if law is None else law
    return Scene(
        Body("block", inertia=1.0, velocity=1.0),
        Contact("floor", "block", GROUND, law, normal=10.0),
        *springs,
    )


# what is composed


def test_every_formulation_method_and_shape_is_tried_on_a_scene_of_hard_contacts():
    found = calls(flywheel_benchmark(), (0.0, 4.0), 1.0)
    assert {call.family for call in found} == {
        "contact-force, series",
        "contact-force, BDF",
        "contact-force, Adams",
        "merged, BDF",
        "merged, Adams",
        "multiplier, BDF",
        "contact-force, RK4",
        "contact-force, Euler",
        *(
            f"pre-slip {shape}, {method}"
            for shape in ("linear", "tanh", "arctan")
            for method in ("BDF", "Adams", "RK4", "Euler")
        ),
    }
    tolerances = [call.options["rtol"] for call in found if call.family == "multiplier, BDF"]
    assert tolerances == pytest.approx([3e-2, *(10.0**-k for k in range(2, 12))], rel=1e-12)
    velocities = {call.pre_slip[0] for call in found if call.pre_slip}
    assert sorted(velocities) == [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1]


def test_pre_slip_velocities_and_absolute_tolerances_follow_the_velocity_scale():
    found = calls(flywheel_benchmark(), (0.0, 4.0), 300.0)
    assert sorted({call.pre_slip[0] for call in found if call.pre_slip}) == [3e-4, 3e-3, 3e-2, 0.3, 3.0, 30.0]
    first = next(call for call in found if call.family == "contact-force, BDF")
    assert first.options == {"method": "BDF", "rtol": 3e-2, "atol": 0.09}


def test_the_series_is_measured_only_where_the_default_takes_it():
    curved = sliding_block(DryFriction(0.2, 0.1, stribeck_velocity=0.1))
    families = {call.family for call in calls(curved, (0.0, 1.0), 1.0)}
    assert "contact-force, BDF" in families and "contact-force, series" not in families


def test_a_tolerance_is_never_looser_than_a_tenth_of_the_pre_slip_velocity():
    for call in calls(flywheel_benchmark(), (0.0, 4.0), 1.0):
        if call.pre_slip and "step" not in call.options:
            assert call.options["rtol"] <= 0.1 * call.pre_slip[0] * (1 + 1e-12)


def test_scenes_of_smooth_contacts_have_no_hard_formulations_and_are_not_regularised_again():
    found = calls(sliding_block(PreSlip(DryFriction(0.2, 0.1))), (0.0, 1.0), 1.0)
    kinds = {call.family.split(",")[0] for call in found}
    assert kinds == {"contact-force"}


def test_families_run_from_cheap_to_costly():
    found = calls(flywheel_benchmark(), (0.0, 4.0), 1.0)
    for family in {call.family for call in found}:
        kind = [call for call in found if call.family == family]
        if family == "contact-force, series":
            assert [call.options for call in kind] == [{}]
        elif "step" in kind[0].options:
            assert all(np.diff([call.options["step"] for call in kind]) <= 0)
            if not kind[0].pre_slip:
                steps = [4 / 30, 0.04, 4 / 300, 0.004, 0.0004]
                assert [call.options["step"] for call in kind] == pytest.approx(steps, rel=1e-5)
        elif not kind[0].pre_slip:
            assert all(np.diff([call.options["rtol"] for call in kind]) < 0)
        else:
            assert all(np.diff([call.pre_slip[0] for call in kind]) <= 0)


def test_who_forbids_creeping_is_advised_no_regularised_call():
    lines = (row("a", 1.0, 1e-3), row("b", 2.0, 1e-3), row("c", 3.0, 1e-6))
    study = Tradeoff(WorkPrecision(lines), 1e-12, "", "", creeping=frozenset({"a"}))
    assert study.recommend(error=1e-2).call == "a"
    assert study.recommend(error=1e-2, may_creep=False).call == "b"
    assert study.recommend(time=1.5).call == "a"
    with pytest.raises(ValueError, match="recommend: no call has"):
        study.recommend(time=1.5, may_creep=False)
    assert all(call.creeps == call.family.startswith("pre-slip") for call in calls(flywheel_benchmark(), (0, 4), 1.0))


def test_the_text_of_a_call_does_what_the_call_does():
    scene = flywheel_benchmark()
    for call in (
        Call("a", {"method": "Adams", "rtol": 1e-6, "atol": 1e-8}),
        Call("b", {"formulation": "merged"}),
        Call("c", {"method": "RK4", "step": 0.04}),
        Call("d", {"rtol": 1e-5}, (0.001, "tanh")),
        Call("e", {"rtol": 1e-5}, (0.001, "linear")),
    ):
        text = call.text((0.0, 1.0))
        pasted = eval(text, {"simulate": simulate, "scene": scene})
        assert np.array_equal(pasted.y, call.run(scene, (0.0, 1.0)).y), text
    assert Call("a", {"method": "Adams", "rtol": 1e-6}).text((0.0, 4.0)) == (
        "simulate(scene, (0.0, 4.0), method='Adams', rtol=1e-06)"
    )


# measured


@pytest.mark.slow
def test_the_benchmark_is_measured_against_a_reference_converged_to_roundoff(benchmark):
    # within its first steps after the kink of the load at 0.5 s the other reference, Adams at 1e-12, is 3e-12 off
    assert benchmark.limit < 1e-11
    (exact,) = [r for r in benchmark.work.rows if r.family == "contact-force, series"]
    assert exact.failure is None and exact.error == benchmark.limit
    stepped = [r for r in benchmark.work.rows if r.family == "contact-force, BDF"]
    # an error below the relative tolerance, also where that is loose
    promised = [float(re.search(r"rtol=([^,]+)", r.name).group(1)) for r in stepped]
    assert len(stepped) > 5 and max(promised) >= 1e-2
    assert all(r.failure is None and r.error < p for r, p in zip(stepped, promised, strict=True))
    # the last one is the tightest
    assert stepped[-1].error < 1e-9
    assert all(r.error >= benchmark.limit for r in benchmark.work.rows if r.failure is None)


def test_errors_of_the_first_short_steps_after_an_event_are_seen() -> None:
    """Adams errs most 0.3 ms after the breakaway at 0.473 s, between two of 1001 even times."""
    scene, span = flywheel_benchmark(), BENCHMARK_SPAN
    found, reference = simulate(scene, span, method="Adams", rtol=0.03), simulate(scene, span)
    times = np.linspace(*span, 200_001)
    worst = float(np.abs(found(times) - reference(times))[:2].max())
    assert worst > 5e-6
    assert _velocity_error(scene, span)(found, reference) == pytest.approx(worst, rel=0.05)


@pytest.mark.slow
def test_pre_slip_errors_are_told(benchmark):
    coarse = [r for r in benchmark.work.rows if "regularized(0.01)" in r.name]
    assert len(coarse) > 2 and all(1e-3 < r.error < 0.1 for r in coarse if r.failure is None)
    # explicit steps longer than the band of pre-slip allows are refused, never wrong
    refused = [r for r in coarse if r.failure is not None]
    assert all("step=" in r.name and "shorten the step, or use BDF" in r.failure for r in refused)
    assert len(refused) < len(coarse)


@pytest.mark.slow
def test_what_is_recommended_can_be_pasted_and_is_as_exact_as_said(benchmark):
    advice = benchmark.recommend(error=1e-4)
    line = str(advice)
    assert line.startswith("simulate(scene") and " ms" in line.split("#")[1]
    ast.parse(line)
    result = eval(line, {"simulate": simulate, "scene": flywheel_benchmark()})
    assert abs(result.velocity("wheel1")[-1] - EXACT_FINAL_VELOCITY) <= 1e-4
    assert advice.error <= 1e-4 and advice.time > 0


@pytest.mark.slow
def test_the_most_accurate_call_within_a_time_is_on_the_front(benchmark):
    slowest = max(r.median for r in benchmark.work.rows if r.failure is None)
    advice = benchmark.recommend(time=slowest)
    assert advice.error == min(r.error for r in benchmark.work.rows if r.failure is None)


@pytest.mark.slow
def test_text_frame_and_plot(benchmark, axes):
    pytest.importorskip("pandas")
    text = str(benchmark)
    assert benchmark.table in text and "reference: simulate(scene" in text
    assert "below what the reference can tell" in text
    assert len(benchmark.to_frame()) == len(benchmark.work.rows)
    drawn = benchmark.plot(ax=axes)
    labels = drawn.get_legend_handles_labels()[1]
    assert drawn is axes and "below what the reference can tell" in labels and "contact-force, BDF" in labels


@pytest.mark.slow
def test_a_crowded_legend_leaves_the_curves_free(benchmark, axes):
    axes.figure.set_size_inches(9.0, 5.0)
    axes.figure.set_layout_engine("constrained")
    benchmark.plot(ax=axes)
    axes.figure.canvas.draw()
    assert axes.get_legend().get_window_extent().x0 >= axes.get_window_extent().x1


@pytest.mark.slow
def test_errors_of_ones_own_get_the_reference(monkeypatch):
    count_work(monkeypatch)
    seen = []

    def error(result, reference):
        seen.append(reference)
        return abs(result.events[-1].t - reference.events[-1].t)

    found = tradeoff(sliding_block(stiffness=2.0), (0.0, 1.5), error=error, budget=1.0)
    assert len({id(reference) for reference in seen}) == 1
    assert found.recommend(error=1e-6).error <= 1e-6


@pytest.mark.slow
def test_a_small_budget_leaves_out_the_costly_and_says_so(monkeypatch):
    count_work(monkeypatch)
    found = tradeoff(flywheel_benchmark(), BENCHMARK_SPAN, budget=0.3)
    assert found.skipped and "left out" in str(found)
    measured = {r.name for r in found.work.rows}
    assert not measured & {skipped.call for skipped in found.skipped}
    reasons = [skipped.reason for skipped in found.skipped]
    assert any(reason.startswith("took") for reason in reasons)
    none_sticks = dataclasses.replace(found, creeping=frozenset(measured))
    with pytest.raises(
        ValueError, match=r"calls were left out, and no other one .* do not creep; give .* larger budget"
    ):
        none_sticks.recommend(error=0.1, may_creep=False)


def test_the_first_call_is_measured_whatever_it_takes() -> None:
    found = tradeoff(sliding_block(), (0.0, 1.5), budget=1e-9)
    assert [row.name for row in found.work.rows] == ["simulate(scene, (0.0, 1.5))"]
    assert found.recommend(error=1e-6).call == "simulate(scene, (0.0, 1.5))"


def test_an_interrupted_tradeoff_hands_over_no_result_of_a_single_call(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(call: Call, scene: Scene, span: tuple[float, float]) -> None:
        raise SimulationInterrupted("interrupted at t = 1 s", simulate(scene, span))

    monkeypatch.setattr(Call, "run", interrupted)
    with pytest.raises(KeyboardInterrupt, match="tradeoff interrupted: nothing is kept") as caught:
        tradeoff(flywheel_benchmark(), BENCHMARK_SPAN)
    assert not isinstance(caught.value, SimulationInterrupted)


def test_warnings_of_calls_are_not_passed_on(monkeypatch):
    def warn(self, scene, span):
        warnings.warn("not safe", stacklevel=1)
        return simulate(scene, span)

    monkeypatch.setattr(Call, "run", warn)
    count_work(monkeypatch)
    assert tradeoff(sliding_block(), (0.0, 1.5), budget=1.0).work.rows


# advice


def test_cheapest_within_an_error_and_most_accurate_within_a_time():
    study = made(row("a", 1.0, 1e-2), row("b", 2.0, 1e-5), row("c", 3.0, 1e-8))
    assert study.recommend(error=1e-4) == Advice("b", 1e-5, 2.0)
    assert study.recommend(time=2.5) == Advice("b", 1e-5, 2.0)
    assert str(study.recommend(time=1.0)) == "a  # error 0.01, 1e+03 ms"


def test_an_error_at_the_limit_is_said_to_be_at_most_that():
    advice = made(row("a", 0.002, 1e-12)).recommend(error=1e-9)
    assert advice.at_limit and str(advice) == "a  # error at most 1e-12, 2 ms"


def test_no_advice_below_what_the_reference_can_tell():
    with pytest.raises(ValueError, match=r"error=1e-13 is below what the reference can tell; allow 1e-12"):
        made(row("a", 1.0, 1e-12)).recommend(error=1e-13)


def test_no_advice_where_no_call_does_it():
    study = made(row("a", 1.0, 1e-2), row("b", 2.0, math.nan, failure="SimulationError: stop"))
    with pytest.raises(ValueError, match=r"recommend: no call has error <= 1e-06; the nearest is 'a'"):
        study.recommend(error=1e-6)
    with pytest.raises(TypeError, match="either error= or time="):
        study.recommend()
    with pytest.raises(TypeError, match="either error= or time="):
        study.recommend(error=1.0, time=1.0)


def test_failures_and_what_was_left_out_are_listed():
    left = (
        Skipped("x", "took 3 s, its share is 1 s"),
        Skipped("y", "not tried, costlier than one that took 3 s"),
    )
    text = str(made(row("a", 1.0, 1e-2), row("b", 2.0, math.nan, failure="SimulationError: stop"), skipped=left))
    assert "FAILED SimulationError: stop" in text
    assert "left out: x: took 3 s, its share is 1 s" in text
    assert "left out untried: 1 costlier calls" in text
    found = made(row("a", 1.0, 1e-2), skipped=left)
    with pytest.raises(ValueError, match=r"Allow as much, or measure more: 2 calls were left out for the budget"):
        found.recommend(error=1e-3)


# arguments and references


@pytest.mark.parametrize(
    ("options", "kind", "message"),
    [
        ({"error": "position"}, TypeError, "error must be 'velocity' or a callable"),
        ({"budget": 0.0}, ValueError, "budget must be a positive number"),
        ({"budget": math.inf}, ValueError, "budget must be a positive number"),
    ],
)
def test_unusable_arguments(options, kind, message):
    with pytest.raises(kind, match=message):
        tradeoff(sliding_block(), (0.0, 1.0), **options)


def test_only_scenes():
    with pytest.raises(TypeError, match="scene must be a Scene"):
        tradeoff("scene", (0.0, 1.0))


def test_a_reference_that_fails_is_tried_again_less_tightly(monkeypatch):
    pairs = list(reference_calls())
    run = Call.run

    def fails_when_tight(self, scene, span):
        if self.options.get("rtol", 1.0) < 5e-12:
            raise SimulationError("too tight", 0.0, {}, None)
        return run(self, scene, span)

    monkeypatch.setattr(Call, "run", fails_when_tight)
    scene = sliding_block()
    tight, loose, *_ = module.reference_of(scene, (0.0, 1.0), lambda result, reference: 0.0)
    assert (tight, loose) == pairs[2]
    monkeypatch.setattr(Call, "run", lambda self, scene, span: simulate(scene, span, rtol=1.0))
    with pytest.raises(ValueError):
        module.reference_of(scene, (0.0, 1.0), lambda result, reference: 0.0)


def test_a_scene_that_cannot_be_simulated_says_so(monkeypatch):
    def fails(self, scene, span):
        raise SimulationError("at t = 1: stop", 1.0, {}, None)

    monkeypatch.setattr(Call, "run", fails)
    with pytest.raises(SimulationError, match="at t = 1: stop"):
        tradeoff(sliding_block(), (0.0, 1.0))


def test_an_error_of_the_reference_that_is_infinite_is_refused():
    scene = Scene(Body("m", inertia=1.0, velocity=0.1))
    with pytest.raises(ValueError, match="is inf between two tight runs of the scene; return a finite number"):
        tradeoff(scene, (0.0, 0.1), error=lambda result, reference: math.inf, budget=0.5)


def test_advice_at_the_limit_of_the_reference_is_plain_python():
    found = tradeoff(Scene(Body("m", inertia=1.0, velocity=0.1)), (0.0, 0.1), budget=0.5)
    advice = found.recommend(error=found.limit)
    assert [type(x) for x in (found.limit, advice.error, advice.at_limit)] == [float, float, bool]


@pytest.mark.parametrize("wrong", ["a", None, math.nan, -1.0, True])
def test_an_error_that_is_no_number_from_0_on_is_refused(wrong):
    scene = Scene(Body("m", inertia=1.0, velocity=0.1))
    with pytest.raises(ValueError, match=r"error\(result, reference\) must return a number that is at least 0"):
        tradeoff(scene, (0.0, 1.0), error=lambda result, reference: wrong, budget=2.0)


@pytest.mark.slow
def test_calls_whose_error_is_negative_have_failed():
    """The signed difference at the end: half of the calls are off to the other side."""
    scene = Scene(Body("m", inertia=1.0, position=1.0), Spring("m", GROUND, stiffness=2.0))
    found = tradeoff(
        scene,
        (0.0, 20.0),
        error=lambda r, q: float(r.position("m")[-1] - q.position("m")[-1]) + 1e-9,
        budget=4.0,
    )
    failed = [row for row in found.work.rows if row.failure is not None]
    assert failed and all("take the absolute value of a difference" in row.failure for row in failed)


@pytest.mark.slow
def test_a_dead_band_that_begins_early_by_roundoff_is_no_error():
    """Where the band begins, Karnopp's law lets the velocity jump by 1e-3 m/s to 0."""
    law = Karnopp(DryFriction(0.3, 0.2), velocity=1e-3)
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("c", "m", GROUND, law, normal=10.0),
        Spring("m", GROUND, stiffness=20.0),
        Force("m", sine(3.0, 0.4)),
    )
    assert any(event.after == 0 for event in simulate(scene, (0.0, 4.0)).events)
    assert tradeoff(scene, (0.0, 4.0), budget=1.0).limit < 1e-9
