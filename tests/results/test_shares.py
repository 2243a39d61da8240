"""The part of the time in each mode, against events and closed forms."""

import math

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    LuGre,
    Mode,
    Scene,
    SimulationError,
    Stop,
    join,
    simulate,
    sine,
)
from stickslip.benchmark import EXACT_EVENTS, flywheel_benchmark

DRY = DryFriction(0.2, 0.1)


def test_the_benchmark_by_its_exact_events():
    result = simulate(flywheel_benchmark(), (0.0, 4.0))
    t = [event.t for event in EXACT_EVENTS]
    share = result.share("interface")
    slipping = (t[0] + t[4] - t[1]) / 4.0
    assert share[Mode.BACKWARD] == pytest.approx(slipping, abs=1e-12)
    assert share[Mode.STUCK] == pytest.approx(1.0 - slipping, abs=1e-12)
    assert share[Mode.FORWARD] == 0.0
    assert sum(result.share("brake").values()) == pytest.approx(1.0, abs=1e-15)


def test_it_does_not_depend_on_the_outputs():
    full = simulate(flywheel_benchmark(), (0.0, 4.0)).share("brake")
    assert simulate(flywheel_benchmark(), (0.0, 4.0), t_eval=[0.0, 4.0]).share("brake") == full


@pytest.mark.slow
def test_a_smooth_law_is_read_off_the_sign_of_its_velocity():
    """A body under 2 pi sin(2 pi t) on stiff bristles moves to and fro: its share is that of dense samples."""
    law = LuGre(DRY, stiffness=1e5, damping=1e2)
    scene = Scene(
        Body("a", inertia=1.0, velocity=-1.0),
        Contact("c", "a", GROUND, law, normal=0.01),
        Force("a", sine(2 * math.pi, 1.0)),
    )
    result = simulate(scene, (0.0, 5.0))
    share = result.share("c")
    times = np.linspace(0.0, 5.0, 200_001)
    forward = np.mean(result.sample(times).velocity("a") > 0)
    assert share[Mode.FORWARD] == pytest.approx(forward, abs=2e-3)
    assert sum(share.values()) == pytest.approx(1.0, abs=1e-12)


def test_a_bouncing_ball_is_open_but_at_rest_on_the_ground():
    """Dropped from h without rebound it falls for sqrt(2 h / g), and rests from then on."""
    scene = Scene(
        Body("ball", inertia=1.0, position=1.0),
        Stop("floor", "ball", GROUND, lower=0.0),
        Force("ball", -9.81),
    )
    share = simulate(scene, (0.0, 1.0)).share("floor")
    falling = math.sqrt(2.0 / 9.81)
    assert set(share) == {Mode.BACKWARD, Mode.OPEN, Mode.FORWARD}
    assert share[Mode.OPEN] == pytest.approx(falling, abs=1e-12)
    assert share[Mode.BACKWARD] == pytest.approx(1.0 - falling, abs=1e-12)


def test_what_cannot_be_told_is_refused():
    few = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=[0.0, 1.0], dense_output=False)
    with pytest.raises(ValueError, match=r"share of 'brake': .* was not kept; simulate with dense_output=True"):
        few.share("brake")
    with pytest.raises(ValueError, match="no contact is called 'x'"):
        few.share("x")


def test_a_run_that_fails_at_its_first_instant(tmp_path):
    """The step of 0.1 s is unstable beside bristles of 1e4 N/m: what is kept is the start, and it can be read."""
    law = LuGre(DryFriction(0.5, 0.4), stiffness=1e4, damping=3.0)
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Contact("c", "a", GROUND, law, normal=2.0))
    with pytest.raises(SimulationError, match="is unstable") as caught:
        simulate(scene, (0.0, 2.0), method="RK4", step=0.1)
    result = caught.value.result
    assert result.t.tolist() == [0.0]
    for one in (result, join([result])):
        assert one.share("c") == {Mode.BACKWARD: 0.0, Mode.STUCK: 0.0, Mode.FORWARD: 1.0}
        assert set(one.fit_for_plot(10).t) == {0.0}
        one.report(tmp_path / "run.html")
        assert "unstable" in (tmp_path / "run.html").read_text()


def test_a_run_without_outputs_did_not_fail():
    nothing = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=[], dense_output=False)
    assert nothing.success
    for read in (lambda: nothing.share("brake"), nothing.final_scene, lambda: nothing.sample(3)):
        with pytest.raises(ValueError, match=r"nothing was kept: .* or came to none of the times asked for"):
            read()
