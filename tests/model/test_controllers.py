"""Ready-made controllers, and runs in a row."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Scene,
    When,
    join,
    output,
    pid,
    position,
    simulate,
    velocity,
)


def servo(**options: Any) -> Scene:
    """A mass with static friction that a controller moves to 1 m."""
    controller = pid("pid", 1 - position("m"), kp=3.0, ki=4.0, kd=6.0, rate=-1 * velocity("m"), **options)
    rub = Contact("rub", "m", GROUND, DryFriction(1.5, 1.0), normal=1.0)
    return Scene(Body("m", inertia=1.0), rub, controller, Force("m", output("pid")))


def test_a_continuous_pid_hunts_in_the_exact_limit_cycle() -> None:
    result = simulate(servo(), (0.0, 250.0))
    assert result.stats["engine"] == "Taylor series"
    stuck = [event.t for event in result.events if event.after == 0]
    np.testing.assert_allclose(abs(1 - result.sample(stuck[-2:]).position("m")), 0.0672401469208670, atol=1e-10)


@pytest.mark.slow
def test_a_fast_sampled_pid_hunts_nearly_so() -> None:
    result = simulate(servo(period=0.01), (0.0, 120.0))
    stuck = [event.t for event in result.events if event.after == 0]
    np.testing.assert_allclose(abs(1 - result.sample(stuck[-2:]).position("m")), 0.0672, atol=2e-3)
    assert result.stats["samples"] == 12000


@pytest.mark.parametrize("period", [None, 0.05])
def test_limits_hold_and_the_integral_does_not_wind_up(period: float | None) -> None:
    free = Scene(*(e for e in servo(low=-2.0, high=2.0, period=period).elements if not isinstance(e, Contact)))
    result = simulate(free, (0.0, 30.0))
    outputs = np.atleast_2d(result.output("pid"))[0]
    assert np.abs(outputs).max() <= 2.0 + 1e-12
    assert abs(result.position("m")[-1] - 1.0) < 1e-2
    if period is None:
        assert result.stats["engine"] == "Taylor series"


def test_what_is_refused() -> None:
    with pytest.raises(ValueError, match="pid 'c': kd needs rate="):
        pid("c", position("m"), kp=1.0, kd=1.0)
    with pytest.raises(ValueError, match="pid 'c': low must be below high"):
        pid("c", position("m"), kp=1.0, low=1.0, high=0.0)
    with pytest.raises(ValueError, match="limits with ki need kp"):
        pid("c", position("m"), kp=0.0, ki=1.0, high=1.0)
    with pytest.raises(ValueError, match="pid 'c': kp must be finite"):
        pid("c", position("m"), kp=math.nan)


def test_runs_in_a_row_are_read_as_one() -> None:
    """A body pushed with 1 N up to 1 m/s, then with 2 N: a gear shift at a condition."""
    first = Scene(Body("m", inertia=1.0), Force("m", 1.0))
    one = simulate(first, (0.0, 9.0), events=[When("shift", velocity("m") - 1.0, stop=True)])
    t = float(one.t[-1])
    second = Scene(*one.final_scene().bodies, Body("n", inertia=1.0, velocity=3.0), Force("m", 2.0))
    both = join([one, simulate(second, (t, 2.0))])
    assert both.t[-1] == 2.0
    assert both.success
    np.testing.assert_allclose(both.velocity("m"), np.where(both.t <= 1, both.t, 2 * both.t - 1), atol=1e-12)
    assert abs(both.position("m")[-1] - 2.5) < 1e-12
    assert np.isnan(both.velocity("n")[0])
    assert both.velocity("n")[-1] == 3.0
    assert [event.contact for event in both.events] == ["shift"]
    assert both.final_scene().bodies[0].velocity == pytest.approx(3.0)
    with pytest.raises(ValueError, match="no body is called 'x'"):
        both.velocity("x")
    with pytest.raises(ValueError, match="run 2 begins at 0 s, but the one before ends at 1 s"):
        join([one, one])
    with pytest.raises(ValueError, match="there are no results"):
        join([])
