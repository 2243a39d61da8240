"""Forces that depend on the state, against closed forms and against springs and dampers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    Karnopp,
    LuGre,
    Mode,
    Quantity,
    Sampled,
    Scene,
    SimulationError,
    Spring,
    StateSpace,
    Stop,
    When,
    explain,
    feedback,
    output,
    pid,
    piecewise_linear,
    position,
    power,
    relative_velocity,
    saturate,
    simulate,
    sine,
    table,
    velocity,
)

WAYS: list[dict[str, Any]] = [
    {},
    {"method": "BDF"},
    {"method": "Adams"},
    {"formulation": "merged"},
    {"formulation": "multiplier"},
]


def pendulum(**options: Any) -> Scene:
    """A pendulum with a dry pivot: m = l = 1, g = 9.81, Coulomb torque 0.5, from rest at 2 rad."""
    weight = feedback(lambda angle: -9.81 * math.sin(angle), position("bob"), **options)
    pivot = Contact("pivot", "bob", GROUND, DryFriction(0.5, 0.5), normal=1.0)
    return Scene(Body("bob", inertia=1.0, position=2.0), pivot, Force("bob", weight))


@pytest.mark.parametrize("way", WAYS)
def test_pendulum_with_a_dry_pivot(way: dict[str, Any]) -> None:
    """Turning points and heat by quadrature of the energy lost, in 30 digits."""
    result = simulate(pendulum(), (0.0, 20.0), rtol=1e-8, atol=1e-10, **way)
    times = [event.t for event in result.events]
    assert len(times) == 16
    exact = [1.295738883638699, 2.522815323600271, 3.701095558678024]
    np.testing.assert_allclose(times[:3], exact, rtol=0, atol=1e-7)
    assert abs(times[15] - 17.30593209725678) < 1e-6
    turns = result.sample(times[:3]).position("bob")
    np.testing.assert_allclose(turns, [-1.795381834762817, 1.619468389438565, -1.46216951947381], atol=1e-7)
    assert result.mode("pivot")[-1] == 0
    assert abs(result.position("bob")[-1] + 0.02645336099859559) < 1e-7
    energy = result.energy()
    assert abs(energy.contacts["pivot"][-1] - 13.88896824427326) < 2e-6
    assert energy.relative_error < 1e-6
    assert abs(energy.loads[-1] - 13.88896824427326) < 2e-6


@pytest.mark.parametrize(
    "derivatives", [lambda angle: -9.81 * math.cos(angle), [lambda angle: -9.81 * math.cos(angle)]]
)
def test_given_derivatives_save_calls(derivatives: Any) -> None:
    plain, helped = (simulate(scene, (0.0, 5.0)) for scene in (pendulum(), pendulum(derivatives=derivatives)))
    assert helped.stats["function_calls"] < plain.stats["function_calls"] <= 2 * plain.stats["rate_calls"]
    assert abs(helped.events[-1].t - plain.events[-1].t) < 1e-6


def test_functions_are_called_for_the_motion_only() -> None:
    """Events of the user, corners of tables and guards of velocities read positions: they call no force."""
    plain = simulate(pendulum(), (0.0, 5.0))
    watched = simulate(pendulum(), (0.0, 5.0), events=[When("bottom", position("bob"))])
    assert len(watched.events) > len(plain.events)
    assert watched.stats["function_calls"] == plain.stats["function_calls"] < 1.5 * plain.stats["rate_calls"]
    softly = Scene(*pendulum().elements, Force("bob", saturate(-0.1 * position("bob"), -0.05, 0.05)))
    limited = simulate(softly, (0.0, 5.0))
    assert limited.stats["function_calls"] < 1.5 * limited.stats["rate_calls"]


def test_an_untouched_pendulum_in_fixed_steps() -> None:
    result = simulate(pendulum(), (0.0, 1.0), method="RK4", step=1e-3)
    exact = simulate(pendulum(), (0.0, 1.0), rtol=1e-10)
    assert abs(result.position("bob")[-1] - exact.position("bob")[-1]) < 1e-9


@pytest.mark.parametrize("way", WAYS)
def test_a_force_beyond_its_level_by_way_of_the_state_breaks_a_contact_loose(way: dict[str, Any]) -> None:
    """A belt drags a block against ``-k x``: the contact lets go at x = B / k = 0.75 m, after B / (k v) = 7.5 s."""
    scene = Scene(
        Body("block", inertia=1.0, velocity=0.1),
        Drive("belt", velocity=0.1),
        Contact("rub", "block", "belt", DryFriction(1.5, 1.0), normal=1.0),
        Force("block", -2.0 * position("block")),
    )
    result = simulate(scene, (0.0, 9.0), **way)
    assert abs(result.events[0].t - 7.5) < 1e-8
    held = result.sample([3.0])
    assert abs(held.force("rub")[0] + 0.6) < 1e-9
    assert held.velocity("block")[0] == 0.1


def test_a_load_driven_by_time_and_by_power() -> None:
    """Heat ``r w = 2 v`` of one contact drives another body: v_b' = 0.1 * 2 v, with v = 4 - 2 t up to 2 s."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=4.0),
        Body("b", inertia=1.0),
        Contact("rub", "a", GROUND, DryFriction(0.2, 0.2), normal=10.0),
        Force("b", 0.1 * power("rub") + 0.5 * TIME),
    )
    result = simulate(scene, (0.0, 3.0), rtol=1e-9)
    assert "power" in explain(scene)
    assert abs(result.velocity("b")[-1] - (0.8 + 2.25)) < 1e-8


MAP = ([0.0, 1.0, 1.5, 3.0], [0.0, 1.0, 0.5, 0.0])
LIMITED = StateSpace("s", A=[[-1.0]], B=[[0.0]], C=[[1.0]], D=[[1.0]], inputs=[power("c")], limits=[(0.0, 0.7)])


@pytest.mark.parametrize("way", [*WAYS, {"method": "RK4", "step": 1e-3}])
@pytest.mark.parametrize(
    ("elements", "rest"),
    [
        ([Force("a", saturate(power("c"), 0.0, 0.7))], 0.5 + math.log(1 / 0.65) / 2),
        ([LIMITED, Force("a", output("s"))], 0.5 + math.log(1 / 0.65) / 2),
        (
            [Force("a", table(power("c"), *MAP))],
            1.5 * math.log(2.5 / 2.25) + math.log(1.5) / 2 + math.log(2) / 2,
        ),
    ],
)
def test_tables_and_limits_of_power(way: dict[str, Any], elements: list[Any], rest: float) -> None:
    """``v' = -2 + g(2 v)`` from v = 1: on each line of g, v is an exponential or falls evenly, until v = 0."""
    rubs = Contact("c", "a", GROUND, DryFriction(0.3, 0.2), normal=10.0)
    result = simulate(Scene(Body("a", inertia=1.0, velocity=1.0), rubs, *elements), (0.0, 2.0), **way)
    (event,) = result.events
    assert (int(event.before), int(event.after)) == (1, 0)
    assert abs(event.t - rest) < (2e-3 if "step" in way else 1e-6)


def test_a_sample_at_the_start_reads_the_power_that_the_friction_has() -> None:
    """It reads 4 W at once, also where a run goes on from another one: the load of 2 N balances friction, v stays."""

    def scene(load: Quantity) -> Scene:
        sampled = Sampled("s", period=0.1, inputs=[power("c")], output=lambda t, x, u: u[0])
        rubs = Contact("c", "a", GROUND, DryFriction(0.3, 0.2), normal=10.0)
        return Scene(Body("a", inertia=1.0, velocity=2.0), rubs, sampled, Force("a", load))

    result = simulate(scene(0.5 * output("s")), (0.0, 0.55))
    assert result.output("s")[0] == result.power("c")[0] == 4.0
    first = simulate(result.scene, (0.0, 0.2))
    second = simulate(first.final_scene(), (0.2, 0.55))
    np.testing.assert_allclose(second.velocity("a"), 2.0, rtol=1e-14)
    np.testing.assert_allclose(result.velocity("a"), 2.0, rtol=1e-14)


@pytest.mark.parametrize(
    "row",
    [
        Stop("limit", "a", GROUND, upper=0.01, restitution=0.5),
        Gap("limit", "a", GROUND, upper=0.01, stiffness=50.0),
    ],
)
@pytest.mark.parametrize(
    "reads",
    [
        [StateSpace("s", A=[[-1.0]], B=[[1.0]], C=[[1.0]], inputs=[power("c")])],
        [Sampled("s", period=0.1, inputs=[power("c")], output=lambda t, x, u: u[0])],
        [Body("z", inertia=1.0), Force("z", table(power("c"), *MAP))],
    ],
)
def test_what_reads_power_beside_a_stop_or_a_gap_changes_nothing(row: Any, reads: list[Any]) -> None:
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.5),
        row,
        Contact("c", "a", GROUND, DryFriction(0.3, 0.2), normal=10.0),
    )
    exact = simulate(scene, (0.0, 0.25))
    result = simulate(Scene(*scene.elements, *reads), (0.0, 0.25), rtol=1e-10, atol=1e-12)
    assert [(e.contact, e.after) for e in result.events] == [(e.contact, e.after) for e in exact.events]
    assert result.position("a")[-1] == pytest.approx(exact.position("a")[-1], abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("way", [*WAYS, {"method": "RK4", "step": 2e-4}])
def test_a_table_of_the_power_of_bristles_that_a_jump_of_the_load_releases(way: dict[str, Any]) -> None:
    """While the normal force is 0 the contact has no power, so the table gives no force: the velocity stays."""
    xs, ys = [-1.0, 0.0, 1.0, 3.0, 4.0], [5.0, 0.0, 0.5, 0.7, 0.0]
    contact = Contact(
        "c",
        "a",
        GROUND,
        LuGre(DryFriction(0.3, 0.2), 1e3, 1.0, 0.1),
        normal=piecewise_linear([0.3, 0.3, 0.6, 0.6], [10.0, 0.0, 0.0, 10.0]),
    )
    scene = Scene(Body("a", inertia=1.0, velocity=2.0), contact, Force("a", table(power("c"), xs, ys)))
    function = feedback(lambda p: float(np.interp(p, xs, ys)), power("c"))
    smooth = Scene(Body("a", inertia=1.0, velocity=2.0), contact, Force("a", function))
    times = [0.3, 0.45, 0.6, 1.0]
    wanted = simulate(smooth, (0.0, 1.0), max_step=1e-3).sample(times).velocity("a")
    found = simulate(scene, (0.0, 1.0), **way).sample(times).velocity("a")
    assert found[1:3] == pytest.approx(found[0], abs=1e-12)
    assert found == pytest.approx(wanted, abs=1e-5)


def test_a_sample_at_the_start_reads_no_power_where_there_is_none() -> None:
    """Two contacts without power: bent bristles with normal force 0, and a contact stuck in Karnopp's dead band."""
    law = DryFriction(0.3, 0.2)
    for contact in (
        Contact("c", "a", GROUND, LuGre(law, 1e3, 1.0, 0.1), normal=0.0, deflection=1e-3),
        Contact("c", "a", GROUND, Karnopp(law, 0.1), normal=10.0),
    ):
        sampled = Sampled("s", period=0.1, inputs=[power("c")], output=lambda t, x, u: u[0])
        result = simulate(Scene(Body("a", inertia=1.0, velocity=0.05), contact, sampled), (0.0, 0.25))
        assert result.output("s")[0] == result.power("c")[0] == 0.0


def test_power_of_a_contact_with_bristles() -> None:
    law = LuGre(DryFriction(0.3, 0.2), stiffness=1e3, damping=10.0)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=1.0),
        Contact("rub", "a", GROUND, law, normal=5.0),
        Force("b", power("rub")),
    )
    result = simulate(scene, (0.0, 0.5), rtol=1e-9)
    assert abs(result.velocity("b")[-1] - result.energy().contacts["rub"][-1]) < 1e-7


def test_quantities_of_held_bodies_are_those_of_what_holds_them() -> None:
    """A gear of 1 : 2 with a damper written as a force on the fast shaft: J' = 1 * 4 + 1, damping 4 c."""
    scene = Scene(
        Body("fast", inertia=1.0, velocity=2.0),
        Body("slow", inertia=1.0, velocity=1.0),
        Gear("gear", "fast", "slow", ratio=2.0),
        Force("fast", feedback(lambda v: -0.5 * v, velocity("fast"))),
    )
    for way in WAYS:
        result = simulate(scene, (0.0, 3.0), **way)
        assert abs(result.velocity("slow")[-1] - math.exp(-3.0 * 2.0 / 5.0)) < 1e-7
        np.testing.assert_array_equal(result.velocity("fast"), 2 * result.velocity("slow"))


@pytest.mark.slow
def test_many_bodies_with_functions_between_them() -> None:
    """A chain with sparse matrices: feedback functions in place of its springs give the same events."""
    count = 170
    bodies = [Body(f"b{k}", inertia=1.0, velocity=0.1 * math.sin(k)) for k in range(count)]
    rubs = [Contact(f"c{k}", f"b{k}", GROUND, DryFriction(0.02, 0.01), normal=1.0) for k in range(count)]
    links: list[Any] = []
    for k in range(count - 1):
        pull = feedback(lambda x, y: 3.0 * (y - x), position(f"b{k}"), position(f"b{k + 1}"))
        links += [Force(f"b{k}", pull), Force(f"b{k + 1}", -pull)]
    springs = [Spring(f"b{k}", f"b{k + 1}", stiffness=3.0) for k in range(count - 1)]
    one = simulate(Scene(*bodies, *rubs, *springs), (0.0, 0.4))
    two = simulate(Scene(*bodies, *rubs, *links), (0.0, 0.4))
    assert [e.contact for e in one.events] == [e.contact for e in two.events]
    np.testing.assert_allclose([e.t for e in two.events], [e.t for e in one.events], rtol=0, atol=1e-7)


def test_what_is_no_number_is_an_error_that_names_element_time_and_arguments() -> None:
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Force("a", feedback(lambda x: 1.0 if x < 0.5 else math.nan, position("a"))),
    )
    with pytest.raises(
        SimulationError, match=r"force on 'a': feedback function .*returned nan at t = 0\.\d+ s"
    ) as caught:
        simulate(scene, (0.0, 2.0))
    assert "with the arguments (0." in str(caught.value)
    assert 0.05 < caught.value.result.t[-1] < 0.5


def test_what_raises_is_named_too() -> None:
    scene = Scene(Body("a", inertia=1.0, position=-1.0), Force("a", feedback(math.sqrt, position("a"))))
    with pytest.raises(SimulationError, match="force on 'a': feedback function sqrt raised ValueError"):
        simulate(scene, (0.0, 2.0))


@pytest.mark.parametrize("pull", [4.5, 4.2, 4.0])
def test_a_force_without_bounds_at_rest_lets_nothing_come_to_rest(pull: float) -> None:
    """Friction ``5 + 0.1 log(w / 0.001)`` has no value at rest; the block slows down until it balances the pull."""
    friction = feedback(lambda w: 5.0 + 0.1 * math.log(abs(w) / 1e-3), relative_velocity("rub"))
    rub = Contact("rub", "block", GROUND, DryFriction(1.0, 1.0), normal=friction)
    scene = Scene(Body("block", inertia=1.0, velocity=1.0), Force("block", pull), rub)
    result = simulate(scene, (0.0, 3.0))
    assert not result.events
    assert abs(result.velocity("block")[-1] / (1e-3 * math.exp((pull - 5.0) / 0.1)) - 1) < 1e-6


def test_a_series_is_refused_where_a_function_acts() -> None:
    with pytest.raises(ValueError, match="'series' does not apply: force on 'bob': feedback function"):
        simulate(pendulum(), (0.0, 1.0), method="series")


def test_a_changed_closure_is_called_again() -> None:
    gain = [1.0]
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Force("a", feedback(lambda v: -gain[0] * v, velocity("a"))))
    first = simulate(scene, (0.0, 1.0)).velocity("a")[-1]
    gain[0] = 2.0
    assert abs(first - math.exp(-1.0)) < 1e-6
    assert abs(simulate(scene, (0.0, 1.0)).velocity("a")[-1] - math.exp(-2.0)) < 1e-6


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("clock", [TIME, position("clock")])
@pytest.mark.parametrize("beside", [0, 1])
def test_a_normal_force_that_is_a_function_ends_and_begins_again(way: dict[str, Any], clock: Any, beside: int) -> None:
    """N = 2 - 4 sin 3t by a function: the motion is that with a sine over time, also with another contact beside it."""

    def scene(normal: Any) -> Scene:
        rubs = [
            Body("rubs", inertia=1.0, velocity=1.0),
            Contact("constant", "rubs", GROUND, DryFriction(0.3, 0.2), normal=1.0),
        ]
        return Scene(
            Body("clock", inertia=1.0, velocity=1.0),
            Body("pressed", inertia=1.0, velocity=1.0),
            Contact("by function", "pressed", GROUND, DryFriction(0.3, 0.2), normal=normal),
            Force("pressed", piecewise_linear([0.0, 1.0, 3.0], [0.0, 0.7, -2.0])),
            *rubs[: 2 * beside],
        )

    exact = simulate(scene(sine(-4.0, 1.5 / math.pi, 0.0, 2.0)), (0.0, 3.0))
    assert exact.stats["engine"] == "Taylor series"
    found = simulate(scene(feedback(lambda t: 2.0 - 4.0 * math.sin(3.0 * t), clock)), (0.0, 3.0), **way)
    stories = [[(event.contact, event.before, event.after) for event in run.events] for run in (found, exact)]
    assert stories[0] == stories[1]
    assert abs(found.velocity("pressed")[-1] - exact.velocity("pressed")[-1]) < 1e-7
    np.testing.assert_allclose([event.t for event in found.events], [event.t for event in exact.events], atol=1e-6)


def test_what_follows_time_and_position_is_read_at_its_time() -> None:
    """The free body is at x = 1 + 2 t m; the contacts are pressed with 4 + t + x = 5 + 3 t and 3 + t x N."""
    path = position("free")
    scene = Scene(
        Body("free", inertia=1.0, position=1.0, velocity=2.0),
        *(Body(name, inertia=1.0) for name in ("left", "right")),
        Contact("linear", "left", GROUND, DryFriction(0.2, 0.1), normal=4.0 + TIME + path),
        Contact(
            "curved",
            "right",
            GROUND,
            DryFriction(0.2, 0.1),
            normal=feedback(lambda x, t: 3 + t * x, path, TIME),
        ),
    )
    t = np.linspace(0.0, 2.0, 9)
    result = simulate(scene, (0.0, 2.0), t_eval=t)
    np.testing.assert_allclose(result.normal("linear"), 5.0 + 3.0 * t, rtol=1e-12)
    np.testing.assert_allclose(result.normal("curved"), 3.0 + t * (1.0 + 2.0 * t), rtol=1e-9)


def saturated_servo(length: float, time: float, *friction: Contact) -> Scene:
    """A mass of 1 kg under a PI controller with limits, with lengths and times in other units."""
    force = length / time**2
    control = pid(
        "control",
        length - position("m"),
        kp=3.0 / time**2,
        ki=4.0 / time**3,
        kd=1.0 / time,
        rate=-1 * velocity("m"),
        low=-2 * force,
        high=2 * force,
    )
    return Scene(Body("m", inertia=1.0), control, Force("m", output("control")), *friction)


@pytest.mark.parametrize(
    ("length", "time", "options", "off"),
    [
        (1e-8, 1e-8, {}, 1e-11),
        (1e-3, 1e-3, {"method": "BDF"}, 5e-6),
        (1e-6, 1e-6, {"method": "BDF"}, 5e-6),
        (1e-9, 1e-6, {"method": "Adams"}, 5e-6),
        (1e-6, 1e-2, {"formulation": "multiplier", "method": "BDF"}, 5e-6),
    ],
)
def test_a_controller_needs_no_units_of_its_own(
    length: float, time: float, options: dict[str, Any], off: float
) -> None:
    """The velocity, in its unit, is the same however small the integral of the error is."""
    times = np.linspace(0.0, 10.0, 101)
    exact = simulate(saturated_servo(1.0, 1.0), (0.0, 10.0), t_eval=times).velocity("m")
    result = simulate(saturated_servo(length, time), (0.0, 10.0 * time), t_eval=times * time, **options)
    assert result.velocity("m") * time / length == pytest.approx(exact, abs=off * abs(exact).max())


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "merged"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("steep", [5.0, 13.0])
@pytest.mark.parametrize("push", [0.08, 0.2])
def test_a_dead_band_ends_at_what_the_normal_force_is_at_rest(
    push: float, steep: float, options: dict[str, Any]
) -> None:
    """``N = 0.3 + k |v - 0.03|``: at the edge of the band, 0.06 m/s, v becomes 0, and the level is 0.15 + 0.015 k.

    Before that, ``u = v - 0.03`` follows ``0.5 u' = -push - 0.15 - 0.5 k u``.
    """
    normal = table(velocity("b"), [0.03 - 10, 0.03, 0.03 + 10], [10 * steep + 0.3, 0.3, 10 * steep + 0.3])
    scene = Scene(
        Body("b", inertia=0.5, velocity=0.08),
        Contact("c", "b", GROUND, Karnopp(DryFriction(0.5, 0.5), 0.06), normal=normal),
        Force("b", -push),
    )
    result = simulate(scene, (0.0, 0.2), **options)
    steady = (push + 0.15) / (0.5 * steep)
    stops = math.log((0.05 + steady) / (0.03 + steady)) / steep
    assert [(e.before, e.after) for e in result.events] == [(Mode.FORWARD, Mode.STUCK)]
    assert result.events[0].t == pytest.approx(stops, abs=3e-9)
    assert result.force("c")[-1] == pytest.approx(-push, abs=1e-12)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_a_dead_band_may_open_its_own_contact(options: dict[str, Any]) -> None:
    """``N = 10 v - 0.3`` is 0.3 N at the edge of the band and 0 at rest: from there the load moves the block back."""
    scene = Scene(
        Body("b", inertia=0.5, velocity=0.08),
        Contact("c", "b", GROUND, Karnopp(DryFriction(0.5, 0.5), 0.06), normal=10 * velocity("b") - 0.3),
        Force("b", -0.5),
    )
    result = simulate(scene, (0.0, 0.2), **options)
    # 0.5 v' = -0.5 - 0.5 (10 v - 0.3) from 0.08 to 0.06, then 0.5 v' = -0.5 from rest
    stops = math.log((0.08 + 0.07) / (0.06 + 0.07)) / 10
    assert [e.after for e in result.events] == [Mode.BACKWARD]
    assert result.events[0].t == pytest.approx(stops, abs=3e-9)
    assert result.velocity("b")[-1] == pytest.approx(-(0.2 - stops), abs=1e-8)


@pytest.mark.parametrize(
    ("speed", "options"), [(3e-11, {}), (1e-9, {"rtol": 1e-6, "atol": 1e-8}), (5e-8, {"rtol": 1e-5, "atol": 1e-7})]
)
def test_a_second_run_for_small_states_of_blocks_keeps_slow_drives_in_view(
    speed: float, options: dict[str, Any]
) -> None:
    """A plate creeps over a block that the floor holds, and rubs with 0.2 N for ever; a filter has tiny states."""
    scene = Scene(
        Body("b", inertia=1.0),
        Drive("plate", velocity=speed),
        Contact("rubs", "b", "plate", DryFriction(0.3, 0.2), normal=1.0),
        Contact("floor", "b", GROUND, DryFriction(0.5, 0.5), normal=10.0),
        StateSpace("filter", [[-0.01]], [[-1e-6]], [[1.0]], inputs=[relative_velocity("rubs")]),
    )
    result = simulate(scene, (0.0, 60.0), method="BDF", **options)
    assert not result.events
    assert result.force("rubs")[-1] == pytest.approx(-0.2, rel=1e-12)
