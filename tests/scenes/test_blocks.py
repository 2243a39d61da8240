"""Blocks: controllers and temperatures beside dry friction, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.signal

from stickslip import (
    GROUND,
    TIME,
    Block,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Result,
    Sampled,
    Scene,
    SimulationError,
    StateSpace,
    feedback,
    output,
    position,
    power,
    saturate,
    simulate,
    sine,
    step,
    velocity,
)

WAYS: list[dict[str, Any]] = [{}, {"method": "BDF"}, {"formulation": "merged"}, {"formulation": "multiplier"}]


def hunting() -> Scene:
    """A mass with stiction under PID control (Armstrong and Amin 1996)."""
    return Scene(
        Body("m", inertia=1.0, position=0.2),
        Contact("rub", "m", GROUND, DryFriction(1.5, 1.0), normal=1.0),
        StateSpace("integral", 0.0, 1.0, 1.0, inputs=[position("m")]),
        Force("m", -6.0 * velocity("m") - 3.0 * position("m") - 4.0 * output("integral")),
    )


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_pid_hunting_is_the_exact_limit_cycle(way: dict[str, Any]) -> None:
    """Amplitude and phases in closed form to 30 digits; deviations shrink by 0.0886 in each half period."""
    result = simulate(hunting(), (0.0, 250.0), rtol=1e-9, **way)
    exact = 1e-11 if result.stats["engine"] == "Taylor series" else 1e-7
    loose = [event.t for event in result.events if event.before == 0]
    stuck = [event.t for event in result.events if event.after == 0 and event.t > loose[0]]
    assert abs(loose[-1] - loose[-3] - 23.3692722930883) < 10 * exact
    assert abs(stuck[-1] - max(t for t in loose if t < stuck[-1]) - 2.56843892210513) < exact
    assert abs(min(t for t in loose if t > stuck[-2]) - stuck[-2] - 9.11619722443900) < 10 * exact
    np.testing.assert_allclose(abs(result.sample(stuck[-2:]).position("m")), 0.0672401469208670, rtol=0, atol=exact)


def servo(calls: list[float] | None = None) -> Scene:
    """A velocity loop sampled every 0.1 s: w+ = w - Ts (kp w + Fc)."""

    def push(t: float, x: Any, u: Any) -> Any:
        if calls is not None:
            calls.append(t)
        return -3.0 * u[0]

    return Scene(
        Body("m", inertia=1.0, velocity=2.0),
        Contact("rub", "m", GROUND, DryFriction(0.5, 0.5), normal=1.0),
        Sampled("servo", period=0.1, inputs=[velocity("m")], output=push),
        Force("m", output("servo")),
    )


@pytest.mark.parametrize("way", [*WAYS, {"method": "RK4", "step": 0.01}])
def test_sampled_servo(way: dict[str, Any]) -> None:
    calls: list[float] = []
    result = simulate(servo(calls), (0.0, 1.0), **way)
    assert calls == pytest.approx(np.arange(10) * 0.1, abs=1e-15)
    assert result.stats["samples"] == 10
    assert abs(result.sample([0.7]).velocity("m")[0] - 0.01176765) < 1e-12
    if "step" not in way:
        assert abs(result.events[0].t - 0.7219831592558943) < 1e-12
    held = result.sample([0.05, 0.0999, 0.1]).output("servo")
    assert held[0] == held[1] == -6.0
    assert held[2] == pytest.approx(-3.0 * (2.0 - 0.65))


@pytest.mark.parametrize("way", [*WAYS, {"method": "Adams"}])
def test_a_sample_pushes_in_the_instant_in_which_a_body_comes_to_rest(way: dict[str, Any]) -> None:
    """2 N stop 2 m/s at 1 s, where a controller begins to push with 2.5 N: the level of 3 N holds the body."""
    push = Sampled("push", period=0.5, inputs=[TIME], output=lambda t, x, u: 2.5 if t > 0.9 else 0.0)
    scene = Scene(
        Body("m", inertia=1.0, velocity=2.0),
        Contact("c", "m", GROUND, DryFriction(0.3, 0.2), normal=10.0),
        push,
        Force("m", output("push")),
    )
    result = simulate(scene, (0.0, 2.0), **way)
    assert [(e.contact, e.after) for e in result.events] == [("c", 0)]
    assert result.events[0].t == pytest.approx(1.0, abs=1e-8)
    assert result.velocity("m")[-1] == 0.0


@pytest.mark.parametrize("way", [*WAYS, {"method": "Adams"}])
def test_states_of_a_controller_have_no_roundoff(way: dict[str, Any]) -> None:
    """Corners of limits lie between the samples: blocks read exactly the numbers that `update` and `output` gave."""
    seen: list[tuple[float, float, float]] = []

    def read(t: float, x: Any, u: Any) -> float:
        seen.append((t, float(x[0]), float(u[0])))
        return 0.0

    ends = (-1.0, 1.0)
    scene = Scene(
        Body("m", inertia=1.0, velocity=2.0),
        Force("m", saturate(2.0 - 3.0 * position("m"), *ends) + saturate(2.0 - 3.0 * velocity("m"), *ends)),
        Sampled("held", period=0.5, inputs=[TIME], output=lambda t, x, u: 3.0),
        Sampled(
            "count",
            period=0.5,
            inputs=[output("held")],
            states=[7.0],
            update=lambda t, x, u: [x[0] + 1.0],
            output=read,
        ),
        Force("m", output("held") + output("count") - 3.0),
    )
    result = simulate(scene, (0.0, 3.9), **way)
    assert [x for _, x, _ in seen] == [7.0 + k for k in range(8)]
    assert {u for t, _, u in seen if t > 0} == {3.0}
    blocks = {b.name: b for b in result.final_scene().elements if isinstance(b, Sampled)}
    assert blocks["held"].held == (3.0,) and blocks["count"].states == (15.0,)


def test_a_sample_reads_left_limits() -> None:
    """Two sampled blocks in a row at the same instants: the second reads the output that the first held before."""
    scene = Scene(
        Body("m", inertia=1.0),
        Sampled("count", period=1.0, states=0.0, update=lambda t, x, u: x + 1, output=lambda t, x, u: x + 10),
        Sampled("late", period=1.0, inputs=output("count"), output=lambda t, x, u: u),
        Sampled("load", period=1.0, inputs=step(2.0), output=lambda t, x, u: u),
    )
    result = simulate(scene, (0.0, 4.5), t_eval=[0.5, 1.5, 2.5, 3.5, 4.5])
    np.testing.assert_array_equal(result.output("count"), [10, 11, 12, 13, 14])
    np.testing.assert_array_equal(result.output("late"), [0, 10, 11, 12, 13])
    np.testing.assert_array_equal(result.output("load"), [0, 0, 0, 1, 1])
    np.testing.assert_array_equal(result.state("count"), [1, 2, 3, 4, 5])


@pytest.mark.parametrize(
    ("first", "period", "jump"),
    [(0.0, 0.1, 0.3), (0.0, 0.3, 0.9), (0.2, 0.1, 0.8), (0.1, 0.05, 0.7), (0.0, 0.007, 0.049)],
)
def test_a_sample_at_a_jump_reads_its_left_limit(first: float, period: float, jump: float) -> None:
    """In floats 3 times 0.1 is beyond 0.3, and 3 times 0.3 is before 0.9: the samples are at the decimals."""
    scene = Scene(
        Body("m", inertia=1.0),
        Sampled("load", period=period, first=first, inputs=step(jump), output=lambda t, x, u: u),
        Force("m", output("load")),
    )
    result = simulate(scene, (0.0, jump + 1.5 * period))
    assert result.output("load")[-1] == 1.0
    assert result.sample([jump + 0.9 * period]).output("load")[0] == 0.0
    # the held output pushes from the sample after the jump on
    assert abs(result.velocity("m")[-1] - 0.5 * period) < 1e-15


@pytest.mark.parametrize("way", WAYS)
def test_a_linear_block_is_exact(way: dict[str, Any]) -> None:
    """A first order lag of time constant 0.5 on a unit step, then a body: v = t - 0.5 (1 - exp(-2 t))."""
    scene = Scene(
        Body("m", inertia=1.0),
        StateSpace("lag", [[-2.0]], [[1.0]], [[2.0]], inputs=[1.0]),
        Force("m", output("lag")),
    )
    result = simulate(scene, (0.0, 3.0), rtol=1e-10, **way)
    tolerance = 1e-13 if result.stats["engine"] == "Taylor series" else 1e-8
    assert abs(result.velocity("m")[-1] - (3.0 - 0.5 * (1 - math.exp(-6.0)))) < tolerance
    assert abs(result.output("lag")[-1] - (1 - math.exp(-6.0))) < tolerance
    np.testing.assert_array_equal(2 * result.state("lag"), result.output("lag"))


def test_a_block_of_code_is_the_linear_one() -> None:
    A, B, C, D = [[0.0, 1.0], [-4.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0], [0.0, 1.0]], [[0.0], [0.3]]
    base = (
        Body("m", inertia=1.0, velocity=1.0),
        Contact("rub", "m", GROUND, DryFriction(0.3, 0.2), normal=1.0),
    )
    load = Force("m", -output("it") + 0.5 * output("it", 1))
    linear = StateSpace("it", A, B, C, D, inputs=[position("m")], states=[0.1, 0.0])
    code = Block(
        "it",
        inputs=[position("m")],
        states=[0.1, 0.0],
        derivative=lambda t, x, u: np.array(A) @ x + np.array(B) @ u,
        output=lambda t, x, u: np.array(C) @ x + np.array(D) @ u,
    )
    one, two = (simulate(Scene(*base, block, load), (0.0, 6.0), rtol=1e-9) for block in (linear, code))
    assert (one.stats["engine"], two.stats["engine"]) == ("Taylor series", "CVODE BDF")
    np.testing.assert_allclose([e.t for e in two.events], [e.t for e in one.events], atol=1e-6)
    times = np.linspace(0.0, 6.0, 20)
    np.testing.assert_allclose(two.sample(times).output("it"), one.sample(times).output("it"), atol=1e-6)
    np.testing.assert_allclose(two.sample(times).state("it"), one.sample(times).state("it"), atol=1e-6)


@pytest.mark.parametrize("way", WAYS)
def test_thermal_clutch(way: dict[str, Any]) -> None:
    """Friction that fades with the heat it makes: r = 0.5 (1 - 0.1 Q), Q' = r w; unit mass from 1 m/s.

    With s the distance, Q = 10 (1 - exp(-s / 20)) and w^2 = 1 - 2 Q: it rests where Q = 1/2.
    """
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Block(
            "heat",
            inputs=[power("rub")],
            states=[0.0],
            derivative=lambda t, x, u: u,
            output=lambda t, x, u: x,
        ),
        Contact("rub", "m", GROUND, DryFriction(0.5, 0.5), normal=1.0 - 0.1 * output("heat")),
    )
    result = simulate(scene, (0.0, 4.0), rtol=1e-9, atol=1e-12, **way)
    assert abs(result.state("heat")[-1] - 0.5) < 1e-7
    assert abs(result.position("m")[-1] + 20.0 * math.log(1 - 0.05)) < 1e-6
    assert abs(result.energy().contacts["rub"][-1] - 0.5) < 1e-7
    assert result.mode("rub")[-1] == 0


def test_python_control_and_scipy_systems_are_taken() -> None:
    system = SimpleNamespace(A=[[-1.0]], B=[[1.0]], C=[[2.0]], D=[[0.5]], dt=0)
    assert StateSpace("it", system, inputs=[1.0]) == StateSpace("it", -1.0, 1.0, 2.0, 0.5, inputs=[1.0])
    system.dt = 0.1
    with pytest.raises(ValueError, match=r"block 'it': the system has a sample time of 0.1; give Sampled"):
        StateSpace("it", system, inputs=[1.0])


def test_transfer_functions_are_taken() -> None:
    lag = scipy.signal.TransferFunction([2.0], [0.01, 1.0])  # 2 / (0.01 s + 1)
    assert StateSpace("it", lag, inputs=[1.0]) == StateSpace("it", -100.0, 1.0, 200.0, 0.0, inputs=[1.0])
    with pytest.raises(ValueError, match=r"has a sample time of 0.1"):
        StateSpace("it", scipy.signal.TransferFunction([1.0], [1.0, 0.5], dt=0.1), inputs=[1.0])
    with pytest.raises(TypeError, match=r"give the state space of the transfer function, control.ss\(system\)"):
        StateSpace("it", SimpleNamespace(num=[1.0], den=[1.0, 1.0]), inputs=[1.0])


def test_linear_blocks_are_data() -> None:
    scene = hunting()
    assert Scene.from_dict(scene.to_dict()) == scene
    limited = StateSpace("it", -1.0, 1.0, 1.0, inputs=[velocity("m")], limits=[(-1.0, math.inf)])
    scene = Scene(Body("m", inertia=1.0), limited, Force("m", output("it")))
    assert Scene.from_dict(scene.to_dict()) == scene
    with pytest.raises(ValueError, match="block 'servo': a sampled block is code, not data"):
        servo().to_dict()


def loop(*blocks: Any, load: Any = 1.0) -> Scene:
    return Scene(Body("m", inertia=1.0), *blocks, Force("m", load))


@pytest.mark.parametrize(
    "make",
    [
        lambda: loop(StateSpace("a", 0.0, 1.0, 1.0, 2.0, inputs=[output("a")]), load=output("a")),
        lambda: loop(
            StateSpace("a", 0.0, 1.0, 1.0, 2.0, inputs=[output("b")]),
            Block("b", inputs=[output("a")], output=lambda t, x, u: u),
            load=output("b"),
        ),
        lambda: loop(Block("a", inputs=[feedback(math.sin, output("a"))], output=lambda t, x, u: u)),
    ],
)
def test_algebraic_loops_are_refused_by_name(make: Any) -> None:
    with pytest.raises(ValueError, match=r" depends on itself .*\(an algebraic loop\): .*block 'a'"):
        simulate(make(), (0.0, 1.0))


def test_a_normal_force_that_depends_on_its_own_power_is_a_loop() -> None:
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("rub", "m", GROUND, DryFriction(0.1, 0.1), normal=1.0 + power("rub")),
    )
    with pytest.raises(ValueError, match="the power of contact 'rub' depends on itself without a state between"):
        simulate(scene, (0.0, 1.0))


@pytest.mark.parametrize("way", WAYS)
def test_loops_through_states_and_samples_run(way: dict[str, Any]) -> None:
    """Between two samples b is held: a comes nearer to it by the factor exp(-0.1), and a pushes the body."""
    scene = loop(
        StateSpace("a", -1.0, 1.0, 1.0, inputs=[output("b")], states=[1.0]),
        Sampled("b", period=0.1, inputs=[output("b"), output("a")], output=lambda t, x, u: 0.5 * u[0] - 0.1 * u[1]),
        load=output("a"),
    )
    result = simulate(scene, (0.0, 1.0), rtol=1e-10, **way)
    a, b, v, shrinks = 1.0, 0.0, 0.0, math.exp(-0.1)
    for _ in range(10):
        b = 0.5 * b - 0.1 * a
        # a goes on as b + (a - b) exp(-s) for 0.1 s: the body gains its integral
        v += 0.1 * b + (a - b) * (1 - shrinks)
        a = b + (a - b) * shrinks
    tolerance = 1e-13 if result.stats["engine"] == "Taylor series" else 1e-8
    at = result.sample([0.95, 1.0])
    assert at.output("b")[0] == pytest.approx(b, abs=tolerance)
    assert at.output("a")[1] == pytest.approx(a, abs=tolerance)
    assert at.velocity("m")[1] == pytest.approx(v, abs=tolerance)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Block("b"), "block 'b': output must be a function of t, x and u, got None"),
        (lambda: Block("b", states=[1.0]), "block 'b': derivative must be a function"),
        (lambda: Block("b", derivative=abs, output=abs), "block 'b': derivative is given without states"),
        (lambda: Block("b", states=["x"], derivative=abs), "block 'b': states must be a number, got 'x'"),
        (lambda: Block("b", inputs=[math.sin], output=abs), "block 'b': input 0 must be a quantity"),
        (lambda: Sampled("s", period=0.0, output=abs), "block 's': period must be positive, got 0"),
        (lambda: Sampled("s", period=1.0, output=None), "block 's': output must be a function"),
        (
            lambda: Sampled("s", period=1.0, output=abs, outputs=0),
            "outputs must be a whole number from 1 on",
        ),
        (
            lambda: Sampled("s", period=1.0, output=abs, outputs=2, held=[1.0]),
            "1 held outputs, but outputs = 2",
        ),
        (lambda: StateSpace("s", [[1, 2]], 1, 1, inputs=[1]), r"A must be square"),
        (
            lambda: StateSpace("s", 1, 1, 1, inputs=[1, 2]),
            r"block 's': B has the shape \(1, 1\), but \(1, 2\) fits",
        ),
        (lambda: StateSpace("s", 1, 1, 1, inputs=[1], states=[1, 2]), "2 states, but A has 1 rows"),
        (lambda: StateSpace("s", math.nan, 1, 1, inputs=[1]), "block 's': A must be finite"),
        (lambda: StateSpace("s", "A", 1, 1, inputs=[1]), "block 's': A must be a matrix, got 'A'"),
        (lambda: StateSpace("s", 1, 1, 1, inputs=[1], limits=[(1, 0)]), "the low limit 1 must be below"),
        (
            lambda: StateSpace("s", 1, 1, [[1], [1]], inputs=[1], limits=[(0, 1), (3, 2)]),
            "the low limit 3 must be below",
        ),
        (lambda: StateSpace("s", 1, 1, 1, inputs=[1], limits=[]), "0 pairs of limits for 1 outputs"),
        (lambda: loop(load=output("b")), "force on 'm': no block is called 'b'; known are none"),
        (
            lambda: loop(StateSpace("b", 1, 1, 1, inputs=[1]), load=output("b", 1)),
            "force on 'm': block 'b' has 1 outputs, so none has the index 1",
        ),
        (
            lambda: loop(Block("b", output=abs), Sampled("b", period=1, output=abs)),
            "the name of block 'b' stands twice",
        ),
    ],
)
def test_what_is_refused(make: Any, message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        make()


@pytest.mark.parametrize(
    ("block", "message"),
    [
        (
            Sampled("c", period=0.25, inputs=[velocity("m")], output=lambda t, x, u: math.nan if t > 0.4 else 0.0),
            r"block 'c': output returned .*nan.* at t = 0.5 s with the inputs \(1\)",
        ),
        (
            Sampled("c", period=0.25, output=lambda t, x, u: []),
            r"output returned .*, but 1 number is needed at t = 0 s",
        ),
        (
            Block("c", states=[0.0], derivative=lambda t, x, u: [1.0, 2.0], output=lambda t, x, u: x),
            "derivative returned .*, but 1 number is needed at t = 0",
        ),
        (Block("c", output=lambda t, x, u: 1 / 0), "block 'c': output raised ZeroDivisionError"),
    ],
)
def test_blocks_that_fail_are_named(block: Any, message: str) -> None:
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), block, Force("m", output("c")))
    with pytest.raises(SimulationError, match=message):
        simulate(scene, (0.0, 1.0))


def controlled() -> Scene:
    """A mass with stiction that a sampled PI controller moves after a drive; a lag filters its measured velocity."""
    return Scene(
        Body("m", inertia=1.0),
        Drive("ref", velocity=sine(0.3, 0.4)),
        Contact("rub", "m", GROUND, DryFriction(0.4, 0.25, dwell=0.1), normal=1.0),
        StateSpace("lag", -5.0, 5.0, 1.0, inputs=[velocity("m")]),
        Sampled(
            "pi",
            period=0.03,
            inputs=[position("ref") - position("m"), output("lag")],
            states=[0.0],
            update=lambda t, x, u: x + 0.03 * u[0],
            output=lambda t, x, u: 8.0 * u[0] - 2.0 * u[1] + 5.0 * x[0],
        ),
        Force("m", output("pi")),
    )


@pytest.fixture(scope="module")
def whole() -> Result:
    return simulate(controlled(), (0.0, 8.0))


@pytest.mark.parametrize("number", range(4))
def test_cut_runs_of_controllers_go_on(number: int, whole: Result) -> None:
    assert len(whole.events) > 5
    rng = np.random.default_rng(number)
    # one cut falls on a sample
    times = [0.0, *np.sort([*rng.uniform(0.0, 8.0, 3), 0.03 * 77]).tolist(), 8.0]
    scene, events, parts = controlled(), [], list[Result]()
    for start, stop in pairwise(times):
        parts.append(simulate(scene, (start, stop)))
        events += parts[-1].events
        scene = parts[-1].final_scene()
    np.testing.assert_allclose([e.t for e in events], [e.t for e in whole.events], rtol=0, atol=1e-11)
    assert sum(part.stats["samples"] for part in parts) == whole.stats["samples"]
    assert abs(parts[-1].velocity("m")[-1] - whole.velocity("m")[-1]) < 1e-11
    assert abs(parts[-1].output("pi")[-1] - whole.output("pi")[-1]) < 1e-11


def by_hand_from_sample_to_sample() -> tuple[list[tuple[float, int]], float, float]:
    """Return the changes of mode, the last position and the last velocity of the body under the controller of 1 kHz.

    Between two samples the push and the friction are constant: the body goes along a parabola, or it rests.
    """
    changes, mode, x, v, state = list[tuple[float, int]](), 0, 0.0, 0.0, 0.0
    for k in range(6000):
        t, left = 1e-3 * k, 1e-3
        error = (1 - math.cos(2 * math.pi * t)) / (2 * math.pi) - x
        push = 30.0 * error - 6.0 * v + 40.0 * state
        state += 1e-3 * error
        while left > 0:
            if mode == 0 and abs(push) > 1.5:
                mode = 1 if push > 0 else -1
                changes.append((t, mode))
            a = push - mode if mode else 0.0
            stops = -v / a if v * a < 0 else math.inf
            h = min(left, stops)
            x, v, t, left = x + v * h + a * h * h / 2, v + a * h, t + h, left - h
            if h == stops:
                mode, v = (0 if abs(push) <= 1.5 else -mode), 0.0
                changes.append((t, mode))
    return changes, x, v


@pytest.mark.slow
def test_a_controller_of_1_khz_is_called_once_for_each_sample() -> None:
    calls = [0]

    def push(t: float, x: Any, u: Any) -> Any:
        calls[0] += 1
        return 30.0 * u[0] - 6.0 * u[1] + 40.0 * x[0]

    scene = Scene(
        Body("m", inertia=1.0),
        Drive("ref", velocity=sine(1.0, 1.0)),
        Contact("rub", "m", GROUND, DryFriction(1.5, 1.0), normal=1.0),
        Sampled(
            "pid",
            period=1e-3,
            inputs=[position("ref") - position("m"), velocity("m")],
            states=[0.0],
            update=lambda t, x, u: x + 1e-3 * u[0],
            output=push,
        ),
        Force("m", output("pid")),
    )
    result = simulate(scene, (0.0, 6.0))
    assert calls[0] == result.stats["samples"] == 6_000
    changes, x, v = by_hand_from_sample_to_sample()
    assert len(changes) > 10
    assert [int(event.after) for event in result.events] == [after for _, after in changes]
    np.testing.assert_allclose([event.t for event in result.events], [t for t, _ in changes], rtol=0, atol=1e-9)
    assert result.position("m")[-1] == pytest.approx(x, abs=1e-9)
    assert result.velocity("m")[-1] == pytest.approx(v, abs=1e-9)


def test_more_samples_than_anyone_waits_for_are_refused() -> None:
    hasty = Sampled("hasty", period=1e-9, inputs=[TIME], output=lambda t, x, u: 0.0)
    with pytest.raises(ValueError, match=r"block 'hasty': a period of 1e-09 s makes 1e\+09 samples in 1 s"):
        simulate(Scene(Body("m", inertia=1.0), hasty, Force("m", output("hasty"))), (0.0, 1.0))


def test_what_is_not_finite_is_told_as_a_number() -> None:
    late = Sampled("late", period=0.5, inputs=[TIME], output=lambda t, x, u: math.inf if t > 1 else 0.0)
    with pytest.raises(
        SimulationError, match=r"block 'late': output returned inf at t = 1.5 s with the inputs"
    ) as error:
        simulate(Scene(Body("m", inertia=1.0), late, Force("m", output("late"))), (0.0, 3.0))
    # there is no contact whose mode the message could name
    assert "modes" not in str(error.value)


def test_results_do_not_ask_how_fast_states_of_blocks_change() -> None:
    """Forces and energies follow from the states: a derivative of the user may be slow."""
    calls = [0]

    def derivative(t: float, x: Sequence[float], u: Sequence[float]) -> list[float]:
        calls[0] += 1
        return [math.sin(u[0]) - x[0]]

    lag = Block("lag", inputs=[position("a")], states=[0.0], derivative=derivative)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("c", "a", GROUND, DryFriction(0.2, 0.1), normal=1.0),
        Force("a", -1 * output("lag")),
        lag,
    )
    result = simulate(scene, (0.0, 5.0))
    during = calls[0]
    energy, force = result.energy(), result.force("c")
    assert calls[0] == during > 0
    moving = np.abs(result.velocity("a")) > 1e-6
    np.testing.assert_allclose(np.abs(force[moving]), 0.1, rtol=1e-12)
    assert energy.relative_error < 1e-6
