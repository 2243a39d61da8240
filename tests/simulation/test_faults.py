"""Failures while a simulation runs end in one kind of error, which holds the result so far."""

from __future__ import annotations

import logging
import math
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
import scipy

from stickslip import (
    GROUND,
    Body,
    Contact,
    Dahl,
    Drive,
    DryFriction,
    Force,
    LuGre,
    PreSlip,
    Scene,
    SimulationError,
    Spring,
    signal,
    simulate,
    sine,
    triangle,
)
from stickslip.engines.solvers.sundials import CVODE
from stickslip.model.laws.dry_friction import Law
from stickslip.model.signals import Signal

LAW = DryFriction(0.3, 0.2)
FLOOR = Contact("floor", "a", GROUND, LAW, normal=1.0)


def oscillator(force: Callable[[float], float]) -> Scene:
    """A block on a spring: x'' + x = F - r."""
    return Scene(
        Body("block", inertia=1.0, velocity=2.0),
        Contact("floor", "block", GROUND, LAW, normal=1.0),
        Spring("block", GROUND, stiffness=1.0),
        Force("block", signal(force, period=1.0)),
    )


def raises_after(t: float) -> float:
    if t > 2.0:
        raise RuntimeError("sensor lost")
    return 0.1 * math.sin(t)


def not_a_number_after(t: float) -> float:
    return math.nan if t > 2.0 else 0.1 * math.sin(t)


def an_array_after(t: float) -> float:
    return np.zeros(3) if t > 2.0 else 0.1 * math.sin(t)  # type: ignore[return-value]


@pytest.mark.parametrize("formulation", ["contact-force", "merged", "multiplier"])
@pytest.mark.parametrize(
    ("force", "sentence"),
    [(raises_after, "sensor lost"), (not_a_number_after, "nan"), (an_array_after, "one finite number")],
)
def test_a_load_that_fails_half_way(
    force: Callable[[float], float], sentence: str, formulation: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # before a run the loads are sampled for their scales: replace this, so that the fault is met in the run only
    monkeypatch.setattr("stickslip.simulation.tolerances.largest_value", lambda *_: 1.0)
    with pytest.raises(SimulationError, match=sentence) as caught:
        simulate(oscillator(force), (0.0, 10.0), formulation=formulation)
    error = caught.value
    assert 0.0 < error.t <= 2.1
    assert set(error.modes) == {"floor"}
    assert not error.result.success
    assert error.result.status == -1
    assert error.result.t.size > 5
    good = simulate(oscillator(lambda t: 0.1 * math.sin(t)), (0.0, 1.0))
    assert error.result(1.0) == pytest.approx(good(1.0), abs=1e-6)


def test_a_load_that_is_bad_from_the_start_is_refused_before_anything_runs() -> None:
    with pytest.raises((ValueError, SimulationError), match="nan"):
        simulate(oscillator(lambda t: math.nan), (0.0, 1.0))


@pytest.mark.slow
def test_a_solver_that_gives_up_says_when_and_in_whose_words() -> None:
    """A load out of all proportion to the tolerance: CVODE's step becomes NaN, and it would step for ever."""
    rough = signal(lambda t: 1e12 * math.copysign(1.0, math.sin(1e9 * t * t)), period=1.0)
    scene = Scene(Body("a", inertia=1.0), Force("a", rough), Spring("a", GROUND, stiffness=1.0))
    with pytest.raises(SimulationError, match=r"not a number|too small") as caught:
        simulate(scene, (0.0, 1e6), rtol=1e-12, atol=1e-300)
    assert caught.value.result.t.size >= 1


def test_multipliers_are_watched_for_steps_too_small(monkeypatch: pytest.MonkeyPatch) -> None:
    """IDA too is stopped where the end is out of reach, here by allowing a hundred evaluations only."""
    monkeypatch.setattr("stickslip.engines.progress._CALLS_BETWEEN_SIGNS", 50)
    monkeypatch.setattr("stickslip.engines.progress._CALLS_BETWEEN_LOOKS", 50)
    monkeypatch.setattr("stickslip.engines.progress.CALLS_AT_MOST", 100)
    scene = oscillator(lambda t: 0.1 * math.sin(t))
    with pytest.raises(SimulationError, match=r"the steps have become too small.*loosen rtol") as caught:
        simulate(scene, (0.0, 10.0), formulation="multiplier")
    assert caught.value.result.t.size > 5
    assert caught.value.t > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-10])
def test_tolerances_below_roundoff_are_met_up_to_roundoff(rtol: float) -> None:
    """At 1 cm roundoff stretches the stiff spring so much that the light body's velocity has errors of 5e-13 m/s."""
    scene = Scene(
        Body("a", inertia=0.03),
        Body("b", inertia=2e-5),
        Contact("c", "a", GROUND, DryFriction(0.5, 0.4), normal=0.004),
        Contact("d", "b", GROUND, DryFriction(0.2, 0.1), normal=0.04),
        Spring("a", GROUND, stiffness=0.5, damping=2000.0),
        Spring("b", "a", stiffness=7e6, damping=30.0),
        Force("a", sine(0.05, 2e-5)),
    )
    result = simulate(scene, (0.0, 8000.0), rtol=rtol)
    assert result.energy().relative_error < max(10 * rtol, 1e-8)
    assert result.velocity("b")[-1] == pytest.approx(result.velocity("a")[-1], rel=1e-5)
    if rtol == 1e-8:
        # a method that is not for stiff motions does not come to the end
        with pytest.raises(SimulationError, match=r"too small.*loosen rtol if it asks for more than roundoff leaves"):
            simulate(scene, (0.0, 8000.0), rtol=rtol, method="Adams")


@pytest.mark.parametrize("law", [Dahl(LAW, 1e4), LuGre(LAW, 1e4)])
def test_bristles_pressed_from_nothing_are_refused(law: Law) -> None:
    normal = triangle(0.5, 1.0, 1.5, slope=10)
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Contact("floor", "a", GROUND, law, normal=normal))
    with pytest.raises(ValueError, match=r"floor.*rises from 0 at t = 0.5.*DryFriction"):
        simulate(scene, (0.0, 2.0))
    assert simulate(scene.replace("floor", normal=normal + 1.0), (0.0, 2.0)).success


def test_pre_slip_below_double_precision_is_refused() -> None:
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Contact("floor", "a", GROUND, PreSlip(LAW, 1e-14), normal=1.0))
    with pytest.raises(ValueError, match=r"floor.*1e-14.*too small.*DryFriction"):
        simulate(scene, (0.0, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("shape", ["linear", "tanh", "arctan"])
@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_loose_tolerances_do_not_break_a_regularised_law(velocity: float, shape: str, method: str) -> None:
    """A block that slides to rest: v = 1 - mu_c N t until t = 0.5, then at rest within the pre-slip velocity."""
    law = DryFriction(0.2, 0.2)
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Contact("floor", "a", GROUND, law, normal=10.0))
    regular = scene.regularized(velocity, shape)
    result = simulate(regular, (0.0, 2.0), t_eval=[0.25, 2.0], rtol=1e-3, atol=1e-5, method=method)
    tail = 40 * math.sqrt(velocity) if shape == "arctan" else 40 * velocity
    assert result.velocity("a") == pytest.approx([0.5, 0.0], abs=tail)


INTERRUPTED_RUN = """
import math, os, signal, sys
import stickslip
from stickslip import Body, Contact, DryFriction, Force, GROUND, SimulationInterrupted, Spring, Scene, simulate

# where tests run in the background of a shell, the signal is ignored
signal.signal(signal.SIGINT, signal.default_int_handler)
calls = 0

def load(t):
    global calls
    calls += 1
    if calls == 10_000:
        os.kill(os.getpid(), signal.SIGINT)
    return math.sin(10.0 * t)

oscillator = (
    Body("a", inertia=1.0, velocity=1.0),
    Spring("a", GROUND, stiffness=1.0),
    Force("a", stickslip.signal(load)),
)
formulation, method = sys.argv[1:]
options = {"step": 1e-3} if method == "RK4" else {"rtol": 1e-12, "atol": 1e-14, "max_step": 0.1}
for count in (0, 1):  # without a contact all is one segment
    floor = [Contact("floor", "a", GROUND, DryFriction(1e-9, 1e-9), normal=1.0)] * count
    calls = 0
    try:
        simulate(Scene(*oscillator, *floor), (0.0, 1e6), formulation=formulation, method=method, **options)
    except SimulationInterrupted as interrupted:
        result = interrupted.result
        print(result.success, result.t.size, len(result.events), signal.getsignal(signal.SIGINT).__name__)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("formulation", "method"),
    [("contact-force", "BDF"), ("merged", "Adams"), ("multiplier", "BDF"), ("contact-force", "RK4")],
)
def test_interruption_keeps_what_was_computed(formulation: str, method: str) -> None:
    # in a process of its own: the signal must not hit the tests
    command = [sys.executable, "-c", INTERRUPTED_RUN, formulation, method]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    without, with_contact = run.stdout.splitlines()
    for line, contacts in ((without, 0), (with_contact, 1)):
        success, points, events, handler = line.split()
        assert success == "False"
        assert int(points) > 10
        assert (int(events) > 0) == (contacts > 0)
        assert handler == "default_int_handler"


# A ball on a spring that yields hits a stop; Ctrl-C at one call of the spring after another.
INTERRUPTED_AT_STOPS = """
import signal, sys
from stickslip import GROUND, Body, Force, Scene, SimulationInterrupted, Stop, feedback, position, simulate

signal.signal(signal.SIGINT, signal.default_int_handler)
places, at = [], None

def yields(x):
    places.append(x)
    if len(places) == at:
        signal.raise_signal(signal.SIGINT)
    return -4.0 * x + x**3

formulation, method = sys.argv[1:]
options = {"formulation": formulation, "method": method}
ball = Scene(
    Body("ball", inertia=1.0, velocity=1.5),
    Force("ball", feedback(yields, position("ball"))),
    Stop("wall", "ball", GROUND, lower=-0.5, upper=0.5, restitution=0.8),
)
simulate(ball, (0.0, 1.5), **options)
# as the solver is about to pass the wall, and now and then
near = {call + k for call, x in enumerate(places) if abs(x) > 0.5 for k in range(-3, 2)}
for call in sorted(near | {*range(3, len(places) - 3, len(places) // 10)}):
    places, at = [], call
    try:
        simulate(ball, (0.0, 1.5), **options)
    except SimulationInterrupted as interrupted:
        result, at = interrupted.result, None
        if result.t[-1] == 1.5:
            continue
        then = simulate(result.final_scene(), (result.t[-1], 1.5), **options)
        print(abs(result.position("ball")).max(), len(result.events) + len(then.events), then.velocity("ball")[-1])
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("formulation", "method"), [("contact-force", "BDF"), ("merged", "Adams"), ("multiplier", "BDF")]
)
def test_an_interrupted_run_ends_at_an_event_at_the_latest(formulation: str, method: str) -> None:
    """Steps of the solver beyond the next impact are no part of the result; a new run goes on from its end."""
    command = [sys.executable, "-c", INTERRUPTED_AT_STOPS, formulation, method]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    farthest, impacts, speeds = np.array([line.split() for line in run.stdout.splitlines()], dtype=float).T
    assert farthest.size >= 20 and farthest.max() <= 0.5 + 1e-12
    assert np.all(impacts == 2)
    assert np.ptp(speeds) < 1e-6


@pytest.mark.parametrize(
    ("formulation", "method"),
    [("contact-force", "BDF"), ("merged", "BDF"), ("multiplier", "BDF"), ("contact-force", "RK4")],
)
def test_a_load_that_fails_leaves_the_points_before(formulation: str, method: str) -> None:
    def load(t: float) -> float:
        if t > 7.3:
            raise RuntimeError("no data")
        return 0.5 * t

    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Spring("a", GROUND, stiffness=2.0),
        Force("a", signal(load)),
        FLOOR,
    )
    step = 1e-2 if method == "RK4" else None
    with pytest.raises(SimulationError, match="no data") as caught:
        simulate(scene, (0.0, 20.0), formulation=formulation, method=method, step=step)
    assert 6.0 < caught.value.t <= 7.3
    assert caught.value.result.t[-1] == caught.value.t


NOISY_RUN = """
import math
import numpy as np
from stickslip import Body, Contact, DryFriction, Force, GROUND, Scene, SimulationError, Spring, signal, simulate
from stickslip.engines.solvers.sundials import CVODE, IDA


def decays(t, y, yp):
    yp[0] = -y[0]


def decays_too(t, y, yp, residual):
    residual[0] = yp[0] + y[0]


def fails(t):
    if t > 0.5:
        raise RuntimeError("sensor lost")
    return 0.0


said = [
    CVODE(decays, max_num_steps=3).solve(np.array([0.0, 1.0, 2.0]), np.ones(1)).message,
    IDA(decays_too, max_num_steps=3).solve(np.array([0.0, 1.0, 2.0]), np.ones(1), -np.ones(1)).message,
]
scene = Scene(
    Body("a", inertia=1.0, velocity=1.0),
    Contact("floor", "a", GROUND, DryFriction(0.2, 0.1), normal=0.1),
    Spring("a", GROUND, stiffness=1.0),
    Force("a", signal(lambda t: fails(t) if t != 1.0 else 0.0, period=10.0)),
)
for formulation in ("contact-force", "multiplier"):
    try:
        simulate(scene, (0.0, 1.0), formulation=formulation)
    except (SimulationError, ValueError) as error:
        said.append(str(error))
print(len([sentence for sentence in said if sentence]))
"""


@pytest.mark.slow
def test_nothing_of_the_solvers_is_printed() -> None:
    """Whatever fails in CVODE, in IDA or in a load: stdout and stderr hold what the script writes and nothing else."""
    run = subprocess.run([sys.executable, "-c", NOISY_RUN], capture_output=True, text=True, timeout=600, check=True)
    assert (run.stdout, run.stderr) == ("4\n", "")


def test_what_sundials_says_can_be_logged(caplog: pytest.LogCaptureFixture) -> None:
    def decays(t: float, y: np.ndarray, rate: np.ndarray) -> None:
        rate[0] = -y[0]

    with caplog.at_level(logging.DEBUG, "stickslip.sundials"):
        assert CVODE(decays, max_num_steps=3).solve(np.array([0.0, 1.0, 2.0]), np.ones(1)).status < 0
    assert "mxstep steps taken before reaching tout" in caplog.text


@pytest.mark.parametrize("law", [Dahl(LAW, 1e4), LuGre(LAW, 1e4)])
@pytest.mark.parametrize(
    "normal", [sine(5.0, 1.0, offset=5.0), sine(5.0, 1.0, offset=5.0002), signal(lambda t: 5.0 * t * t)]
)
def test_bristles_pressed_from_nearly_nothing_are_refused(law: Law, normal: Signal) -> None:
    # CVODE lost 17 % of the friction under the second force, and all of it under the third, without a word
    scene = Scene(Body("a", inertia=1.0, velocity=9.0), Contact("floor", "a", GROUND, law, normal=normal))
    with pytest.raises(ValueError, match=r"floor.* normal force comes back from nearly 0 at t = .*DryFriction"):
        simulate(scene, (0.0, 2.0))
    assert simulate(scene.replace("floor", normal=normal + 0.1), (0.0, 0.1)).success


@pytest.mark.parametrize("dwell", [5e-14, 1e-12, 1e-9])
def test_a_level_that_rises_at_once_is_a_level(dwell: float) -> None:
    """A block on a belt sticks and slips as with a dwell of 1 ms: 11 changes in 50 s."""

    def events(dwell: float) -> list[float]:
        scene = Scene(
            Drive("belt", velocity=0.3),
            Body("b", inertia=1.0, velocity=0.3, position=0.5),
            Contact("c", "b", "belt", DryFriction(0.35, 0.2, dwell=dwell), normal=5.0),
            Spring("b", GROUND, stiffness=1.0, damping=0.05),
        )
        return [event.t for event in simulate(scene, (0.0, 50.0)).events]

    assert len(events(1e-3)) == 11
    assert events(dwell) == pytest.approx(events(1e-3), abs=1e-9)


def test_a_dwell_below_the_roundoff_of_the_time_is_refused() -> None:
    scene = Scene(Body("b", inertia=1.0), Contact("c", "b", GROUND, DryFriction(0.35, 0.2, dwell=1e-15), normal=5.0))
    with pytest.raises(ValueError, match="contact 'c': a dwell time of 1e-15 s cannot be told at times of 50 s"):
        simulate(scene, (0.0, 50.0))
    assert simulate(scene, (0.0, 0.1)).success


@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_a_curve_is_needed_at_speeds_of_the_motion_only(method: str) -> None:
    """Steps overshoot rest by far; a curve that ends at 2 m/s is enough for a body that never has more than 1 m/s.

    From 1 m/s it comes to rest after the integral of ``1 / (g mu_k(w))``.
    """

    def curve(speed: float) -> float:
        if speed > 2.0:
            raise ValueError("not measured")
        return 0.25 if speed > 0.3 else 0.25 + 0.05 * (1.0 - speed / 0.3) ** 3

    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("c", "m", GROUND, DryFriction(0.3, 0.1, kinetic=curve), normal=10.0),
    )
    (rest,) = simulate(scene, (0.0, 2.0), method=method).events
    time = scipy.integrate.quad(lambda w: 0.1 / curve(w), 0.0, 1.0, points=[0.3], epsabs=1e-13)[0]
    assert rest.after == 0 and rest.t == pytest.approx(time, abs=1e-7)
    too_fast = scene.replace("m", velocity=2.5)
    with pytest.raises(SimulationError, match=r"contact 'c': DryFriction: kinetic\(2\.\d*\) raised ValueError"):
        simulate(too_fast, (0.0, 2.0), method=method)
