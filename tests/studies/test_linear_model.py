"""Linear models: closed forms, and small motions of the scene itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lsim, step

from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    LuGre,
    Mode,
    Quantity,
    Scene,
    Spring,
    StateSpace,
    Stop,
    Tie,
    feedback,
    linearize,
    normal,
    output,
    pid,
    position,
    power,
    relative_velocity,
    saturate,
    simulate,
    sine,
    table,
    velocity,
)


def test_normal_forces_of_contacts_are_inputs_and_those_of_ties_are_none() -> None:
    """The mass slips forward against 0.1 times its normal force; with the wheel it has 1 kg + 2^2 * 0.5 kg = 3 kg."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Body("wheel", inertia=0.5, velocity=2.0),
        Gear("gear", "wheel", "m", ratio=2.0),
        Contact("c", "m", GROUND, DryFriction(0.2, 0.1), normal=10.0),
    )
    model = linearize(scene)
    assert model.inputs == ("force(m)", "force(wheel)", "normal(c)")
    row = model.states.index("velocity(m)")
    assert np.allclose(model.B[row], [1 / 3, 2 / 3, -0.1 / 3])


@pytest.mark.parametrize(
    ("push", "by_normal", "by_belt"),
    [
        # v' = -0.4 N + push, with N = 10 N, w = 2 m/s - 0.5 m/s
        (feedback(lambda n: 0.01 * n * n, normal("c")), -0.4 + 0.2, 0.0),
        (table(normal("c"), [-100.0, 100.0], [-10.0, 10.0]), -0.4 + 0.1, 0.0),
        (feedback(lambda v: v * v, velocity("belt")), -0.4, 1.0),
        (feedback(lambda w: w * w, relative_velocity("c")), -0.4, -3.0),
        (0.1 * power("c"), -0.4 + 0.04 * 1.5, -0.4),
        (output("square"), -0.4, -3.0),
    ],
)
def test_forces_that_read_inputs_by_functions(push: Quantity, by_normal: float, by_belt: float) -> None:
    scene = Scene(
        Body("m", inertia=1.0, velocity=2.0),
        Drive("belt", velocity=0.5),
        Contact("c", "m", "belt", DryFriction(0.4, 0.4), normal=10.0),
        Block("square", inputs=[relative_velocity("c")], output=lambda t, x, u: u[0] ** 2),
        Force("m", push),
    )
    model = linearize(scene)
    assert model.inputs == ("force(m)", "normal(c)", "velocity(belt)", "acceleration(belt)")
    assert model.B[0] == pytest.approx([1.0, by_normal, by_belt, 0.0], abs=1e-6)


def test_a_contact_that_another_one_presses_follows_its_normal_force() -> None:
    """Both brake the body: v' = -0.2 N - 0.4 (1.5 N)."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=2.0),
        Contact("c", "m", GROUND, DryFriction(0.2, 0.2), normal=10.0),
        Contact("d", "m", GROUND, DryFriction(0.4, 0.4), normal=1.5 * normal("c")),
    )
    model = linearize(scene)
    place = model.inputs.index("normal(c)")
    assert model.B[0, place] == pytest.approx(-0.8)
    assert model.D[model.outputs.index("force(d)"), place] == pytest.approx(0.6)


def test_the_power_of_bristles_depends_on_their_deflection() -> None:
    """``v' = -(1 - g v) r`` with ``r = 25 z``: its derivative by z is -25 (1 - g v)."""
    law = LuGre(DryFriction(0.4, 0.3), stiffness=25.0, damping=0.0)
    contact = Contact("c", "m", GROUND, law, normal=10.0, deflection=0.05)
    scene = Scene(Body("m", inertia=1.0, velocity=1.5), contact, Force("m", 0.05 * power("c")))
    model = linearize(scene)
    assert model.states == ("velocity(m)", "deflection(c)")
    assert model.A[0, 1] == pytest.approx(-25.0 * (1 - 0.05 * 1.5))


def test_a_mass_on_a_spring() -> None:
    scene = Scene(Body("m", inertia=2.0), Spring("m", GROUND, stiffness=8.0, damping=0.4))
    model = linearize(scene)
    assert model.states == ("velocity(m)", "position(m)") and model.inputs == ("force(m)",)
    assert np.allclose(model.A, [[-0.2, -4.0], [1.0, 0.0]]) and np.allclose(model.B, [[0.5], [0.0]])
    assert model.outputs == ("velocity(m)", "position(m)")
    assert np.allclose(model.C, np.eye(2)) and not model.D.any()
    assert model.eigenvalues == pytest.approx([-0.1 - 1j * math.sqrt(3.99), -0.1 + 1j * math.sqrt(3.99)])
    assert model.frequencies == pytest.approx([math.sqrt(3.99)]) and model.stable
    assert "eigenvalue -0.1" in str(model)


def pair(law: DryFriction, **velocity: float) -> Scene:
    return Scene(
        Body("a", inertia=1.0, velocity=velocity.get("a", 0.0)),
        Body("b", inertia=3.0, velocity=velocity.get("b", 0.0)),
        Contact("c", "a", "b", law, normal=10.0),
        Spring("a", GROUND, stiffness=16.0),
    )


def test_stuck_contacts_are_constraints() -> None:
    """Stuck, both swing with sqrt(16 / 4); slipping, the first alone with sqrt(16 / 1)."""
    law = DryFriction(0.5, 0.5)
    stuck, slipping = linearize(pair(law)), linearize(pair(law, a=1.0))
    assert stuck.modes == {"c": Mode.STUCK} and slipping.modes == {"c": Mode.FORWARD}
    assert stuck.frequencies == pytest.approx([2.0]) and slipping.frequencies == pytest.approx([4.0])
    assert len(stuck.states) == 2 and len(slipping.states) == 3
    # b = 3 is carried by the contact: the force on it is 3/4 of what pulls at a
    force = stuck.select(["force(a)", "force(b)"], ["force(c)", "velocity(b)"])
    assert np.allclose(force.D, [[0.75, -0.25], [0.0, 0.0]])
    assert np.allclose(force.C @ _position(stuck, "a"), [-12.0, 0.0])
    assert np.allclose(slipping.select(["normal(c)"], ["force(c)"]).D, [[0.5]])
    _, x = step(stuck.select(["force(a)"], ["position(a)"]).to_scipy(), T=np.linspace(0.0, 5.0, 11))
    assert x[-1] == pytest.approx((1 - math.cos(10.0)) / 16, abs=1e-14)


def _position(model: object, body: str) -> np.ndarray:
    states = model.states  # type: ignore[attr-defined]
    return np.array([float(name == f"position({body})") for name in states])


def test_a_kinetic_curve_is_a_negative_damper() -> None:
    """Sliding on a belt: x'' - s x' + x = 0 with the slope s of the curve at the speed of the belt."""
    law = DryFriction(1.0, 1.0, kinetic=lambda v: 1.0 / (1.0 + 3.0 * abs(v)))
    scene = Scene(
        Body("m", inertia=1.0, position=1 / 1.6),
        Drive("belt", velocity=0.2),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", "belt", law, normal=1.0),
    )
    slope = 3.0 / 1.6**2
    model = linearize(scene)
    found = np.roots([1.0, -slope, 1.0])
    assert np.allclose(sorted(model.eigenvalues, key=lambda z: z.imag), sorted(found, key=lambda z: z.imag), atol=1e-8)
    assert not model.stable
    # the belt pulls by the slope of the curve, too
    assert model.select(["velocity(belt)"]).B[0, 0] == pytest.approx(-slope, abs=1e-7)


def test_bristles_that_the_motion_presses_on() -> None:
    """Unit mass, spring 2; z' = w - s0 |w| z / g, r = s0 z + s1 z', g = (1 + 0.5 exp(-(w / 0.05)^2)) (N0 + 1.5 x)."""
    s0, s1, start = 1e3, 10.0, np.array([0.12, 0.02, 1e-3])

    def by_hand(y: np.ndarray, belt: float) -> np.ndarray:
        """Rates of v, x and z, and the force."""
        (v, x, z), w = y, y[0] - belt
        g = (1.0 + 0.5 * math.exp(-((w / 0.05) ** 2))) * (2.0 + 1.5 * x)
        rate = w - s0 * abs(w) * z / g
        r = s0 * z + s1 * rate
        return np.array([-2.0 * x - r, v, rate, r])

    law = LuGre(DryFriction(1.5, 1.0, stribeck_velocity=0.05), stiffness=s0, damping=s1)
    model = linearize(
        Scene(
            Body("m", inertia=1.0, velocity=start[0], position=start[1]),
            Drive("belt", velocity=0.1),
            Spring("m", GROUND, stiffness=2.0),
            Contact("c", "m", "belt", law, normal=2.0 + 1.5 * position("m"), deflection=start[2]),
        )
    ).select(["velocity(belt)"], ["force(c)"])
    assert model.states == ("velocity(m)", "position(m)", "deflection(c)")
    h = 1e-6
    by_states = [(by_hand(start + e, 0.1) - by_hand(start - e, 0.1)) / (2 * h) for e in h * np.eye(3)]
    by_belt = (by_hand(start, 0.1 + h) - by_hand(start, 0.1 - h)) / (2 * h)
    assert np.allclose(np.vstack([model.A, model.C]), np.transpose(by_states), rtol=1e-6, atol=1e-7)
    assert np.allclose(np.concatenate([model.B[:, 0], model.D[0]]), by_belt, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_forces_in_other_units(unit: float) -> None:
    """dr/dw = -2 w / v_s^2 (mu_s - mu_c) exp(-(w / v_s)^2) N, at speeds far from 1 m/s."""
    law = DryFriction(0.6, 0.4, stribeck_velocity=unit)
    scene = Scene(Body("m", inertia=1.0, velocity=2 * unit), Contact("c", "m", GROUND, law, normal=3.0))
    model = linearize(scene).select([], ["force(c)"])
    assert model.C[0, 0] == pytest.approx(-4 / unit * 0.2 * math.exp(-4.0) * 3.0, rel=1e-12)


def test_a_normal_force_that_follows_a_carried_body() -> None:
    """Body m rides on a belt; body a slips with r = 0.3 (2 + 0.7 v_belt), and a damper of 0.8 joins them."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=0.1),
        Body("a", inertia=2.0, velocity=0.5),
        Drive("belt", velocity=0.1),
        Contact("c", "m", "belt", DryFriction(1.5, 1.0), normal=50.0),
        Contact("d", "a", GROUND, DryFriction(0.5, 0.3), normal=2.0 + 0.7 * velocity("m")),
        Damper("m", "a", damping=0.8),
    )
    model = linearize(scene).select(["velocity(belt)"], ["force(c)", "force(d)", "velocity(m)"])
    assert model.states == ("velocity(a)",)
    assert np.allclose(model.D[:, 0], [-0.8, 0.21, 1.0], atol=1e-14)
    assert np.allclose(model.B, [[(0.8 - 0.21) / 2]], atol=1e-14)


def test_small_motions_of_the_scene_follow_the_model() -> None:
    """A drive line with a gear and a stuck clutch, under a small torque."""
    law = DryFriction(0.5, 0.5)
    elements = (
        Body("motor", inertia=0.2),
        Body("wheel", inertia=1.0),
        Body("load", inertia=2.0),
        Gear("gear", "motor", "wheel", ratio=3.0),
        Contact("clutch", "wheel", "load", law, normal=100.0),
        Spring("load", GROUND, stiffness=20.0, damping=0.3),
        Damper("motor", GROUND, damping=0.05),
    )
    torque = sine(0.1, 0.4)
    model = linearize(Scene(*elements)).select(["force(motor)"])
    t = np.linspace(0.0, 6.0, 3001)
    _, y, _ = lsim(model.to_scipy(), [torque(x) for x in t], t)
    result = simulate(Scene(*elements, Force("motor", torque)), (0.0, 6.0), t_eval=t)
    for name, read in (
        ("velocity(load)", result.velocity("load")),
        ("velocity(motor)", result.velocity("motor")),
        ("force(clutch)", result.force("clutch")),
        ("force(gear)", result.force("gear")),
        ("position(load)", result.position("load")),
    ):
        assert np.allclose(y[:, model.outputs.index(name)], read, atol=2e-6 * np.ptp(read)), name


def coupled(mu: float) -> Scene:
    """A mass with a tangential and a normal motion, on springs at 30 and 150 degrees, pressed on a belt by a third."""
    angles = [(2.0, math.radians(30.0)), (1.0, math.radians(150.0))]
    return Scene(
        Body("along", inertia=1.0),
        Body("across", inertia=1.0),
        Drive("belt", velocity=10.0),
        *(Spring("along", "across", stiffness=k, radius_a=math.cos(a), radius_b=-math.sin(a)) for k, a in angles),
        Spring("across", GROUND, stiffness=1.5),
        Contact("rub", "along", "belt", DryFriction(mu, mu), normal=10.0 + 1.5 * position("across")),
    )


def test_squeal_by_mode_coupling() -> None:
    """Flutter from mu = 0.2886751345948129 = sqrt(3) / 6, with the frequency 1.5."""
    limit = 0.2886751345948129
    below, above = linearize(coupled(0.999 * limit)), linearize(coupled(1.001 * limit))
    assert below.stable and not above.stable
    assert np.allclose(above.frequencies, 1.5, atol=2e-6)
    # the frequencies meet as the square root of the distance: s^2 = -2.25 +- sqrt(0.433 (0.433 - 1.5 mu))
    shift = math.sqrt(0.1875 * 0.001)
    assert np.allclose(np.sort(below.frequencies**2), [2.25 - shift, 2.25 + shift], atol=1e-12)
    assert above.eigenvalues[0].real == pytest.approx(np.sqrt(complex(-2.25, shift)).real, abs=1e-12)
    g = math.sqrt(3) / 4
    loud = linearize(coupled(0.32)).eigenvalues[0].real
    assert loud == pytest.approx(np.sqrt(complex(-2.25, math.sqrt(g * (0.48 - g)))).real, abs=1e-12)
    assert loud == pytest.approx(0.04752, abs=5e-6)


def test_loads_are_read_at_a_time() -> None:
    """The contact is pressed from 1 s on: then it holds the body, which has no frequency."""
    from stickslip import step

    contact = Contact("c", "m", GROUND, DryFriction(0.5, 0.5), normal=step(1.0))
    scene = Scene(Body("m", inertia=1.0), contact, Spring("m", GROUND, stiffness=1.0))
    assert linearize(scene).frequencies == pytest.approx([1.0])
    assert linearize(scene, t=2.0).frequencies.size == 0


def test_a_closed_stop_fixes_a_position() -> None:
    """Only the other body swings, with sqrt(3 / 1); the stop carries what pulls at the first."""
    scene = Scene(
        Body("m", inertia=2.0, position=1.0),
        Body("b", inertia=1.0),
        Spring("m", "b", stiffness=3.0, damping=0.1),
        Force("m", 10.0),
        Stop("w", "m", GROUND, upper=1.0),
    )
    model = linearize(scene)
    assert model.states == ("velocity(b)", "position(b)") and model.modes == {"w": Mode.FORWARD}
    assert np.allclose(model.A, [[-0.1, -3.0], [1.0, 0.0]])
    part = model.select(["force(m)", "force(b)"], ["force(w)", "position(m)"])
    assert np.allclose(part.C, [[0.1, 3.0], [0.0, 0.0]]) and np.allclose(part.D, [[1.0, 0.0], [0.0, 0.0]])
    # two bodies that a stop holds together swing as one
    both = Scene(
        Body("m", inertia=2.0, position=1.0),
        Body("b", inertia=1.0, position=0.5),
        Spring("m", GROUND, stiffness=3.0),
        Force("m", 10.0),
        Stop("w", "m", "b", upper=0.5),
    )
    assert linearize(both).frequencies == pytest.approx([1.0]) and len(linearize(both).states) == 2


def test_states_of_controllers() -> None:
    """x'' = -2 x' - 3 x - i / 2, i' = x."""
    integral = StateSpace("i", [[0.0]], [[1.0]], [[1.0]], inputs=[position("m")])
    push = Force("m", -3 * position("m") - 2 * velocity("m") - 0.5 * output("i"))
    model = linearize(Scene(Body("m", inertia=1.0), integral, push))
    assert model.states == ("velocity(m)", "position(m)", "state(i, 0)")
    assert np.sort_complex(model.eigenvalues) == pytest.approx(np.sort_complex(np.roots([1, 2, 3, 0.5])))


def test_a_slipping_contact_whose_normal_force_depends_on_the_state() -> None:
    """mu(u) = c + (s - c) exp(-(u/v)^2), u = v_belt - v: the force mu N changes by (N dmu/dv + mu dN/dv) v' + ..."""
    law = DryFriction(0.6, 0.3, stribeck_velocity=0.3)
    load = 1.0 + 0.5 * position("m") + 0.2 * velocity("m")
    scene = Scene(
        Body("m", inertia=1.0, position=0.1),
        Drive("belt", velocity=0.5),
        Spring("m", GROUND, stiffness=3.0),
        Contact("c", "m", "belt", law, normal=load),
    )
    peak = 0.3 * math.exp(-((0.5 / 0.3) ** 2))
    by_speed, by_place = 1.05 * 2 * 0.5 / 0.3**2 * peak + 0.2 * (0.3 + peak), 0.5 * (0.3 + peak)
    assert np.allclose(linearize(scene).A, [[by_speed, by_place - 3.0], [1.0, 0.0]], atol=1e-8)


def test_at_a_corner_there_are_two_models() -> None:
    body = Body("m", inertia=1.0, position=1.0)
    with pytest.raises(ValueError, match="corner 1, where its slope changes"):
        linearize(Scene(body, Force("m", saturate(-position("m") + 2.0, -1.0, 1.0))))
    with pytest.raises(ValueError, match="gap 'g' is just at its limit"):
        linearize(Scene(body, Gap("g", "m", GROUND, upper=1.0, stiffness=2.0)))
    beside = linearize(Scene(Body("m", inertia=1.0, position=1.5), Force("m", saturate(-position("m"), -2.0, 1.0))))
    assert beside.frequencies == pytest.approx([1.0])


def test_the_force_of_a_gap_is_an_output() -> None:
    """The stretch is 0.5 x, so ``dr/dx = 0.5 * 20`` and ``dr/dv = 0.5 * 0.3``; within the limits the force is 0."""
    gap = Gap("g", "m", GROUND, upper=1.0, lower=-1.0, stiffness=20.0, damping=0.3, radius_a=0.5)
    for place, stiffness, damping in ((2.5, 10.0, 0.15), (0.0, 0.0, 0.0), (-2.5, 10.0, 0.15)):
        model = linearize(Scene(Body("m", inertia=2.0, position=place), gap)).select(outputs=["force(g)"])
        assert model.states == ("velocity(m)", "position(m)")
        assert np.allclose(model.C, [[damping, stiffness]]) and not model.D.any()


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(TypeError, match="must be a Scene"):
        linearize(1)  # type: ignore[arg-type]
    model = linearize(Scene(Body("m", inertia=2.0), Spring("m", GROUND, stiffness=8.0)))
    with pytest.raises(ValueError, match="no input is called"):
        model.select(["torque(m)"])
    with pytest.raises(ValueError, match="no output is called"):
        model.select(outputs=["speed(m)"])


def test_python_control() -> None:
    control = pytest.importorskip("control")
    model = linearize(Scene(Body("m", inertia=2.0), Spring("m", GROUND, stiffness=8.0)))
    other = model.to_control()
    assert isinstance(other, control.StateSpace) and list(other.state_labels) == list(model.states)


def test_without_python_control_it_is_said() -> None:
    try:
        import control  # noqa: F401
    except ImportError:
        model = linearize(Scene(Body("m", inertia=2.0), Spring("m", GROUND, stiffness=8.0)))
        with pytest.raises(ImportError, match="pip install control"):
            model.to_control()


@pytest.mark.parametrize("slips", [True, False])
@pytest.mark.parametrize("limits", [{}, {"low": -9.0, "high": 9.0}])
def test_a_controller_has_states_of_its_own(slips: bool, limits: dict[str, float]) -> None:
    control = pid("pid", 1 - position("m"), kp=3.0, ki=4.0, kd=6.0, rate=-1 * velocity("m"), **limits)
    rub = Contact("rub", "m", GROUND, DryFriction(8.0, 1.0), normal=1.0)
    scene = Scene(Body("m", inertia=1.0, velocity=0.1 if slips else 0.0), rub, control, Force("m", output("pid")))
    model = linearize(scene)
    # slipping: s^3 + 6 s^2 + 3 s + 4 = 0; stuck: nothing moves but the integral, which only sums up
    expected = np.roots([1.0, 6.0, 3.0, 4.0]) if slips else np.zeros(model.A.shape[0])
    assert np.allclose(np.sort_complex(model.eigenvalues), np.sort_complex(expected), atol=1e-7)
    assert "state(pid, 0)" in model.states


def test_states_of_a_block_are_counted_and_sampled_ones_refused() -> None:
    turning = Block("b", inputs=[], states=[1.0, 0.0], derivative=lambda t, x, u: [x[1], -4 * x[0]])
    model = linearize(Scene(Body("m", inertia=1.0), turning, Force("m", output("b", 0))))
    assert model.states == ("velocity(m)", "state(b, 0)", "state(b, 1)")
    assert model.frequencies == pytest.approx([2.0])
    sampled = pid("servo", position("m"), kp=1.0, period=0.01)
    with pytest.raises(ValueError, match="sampled blocks have no linear model"):
        linearize(Scene(Body("m", inertia=1.0), sampled, Force("m", output("servo"))))


# Roundoff of eigenvalues


@pytest.mark.parametrize("lag", [0.1, 1e-3, 1e-5])
def test_what_grows_slowly_beside_a_fast_decay_is_not_stable(lag: float) -> None:
    """``1000 x'' = -x - x' + 1.2 x'``: eigenvalues ``1e-4 +- 0.0316 i``, whatever the lag of the motor."""
    scene = Scene(
        Body("m", inertia=1000.0, position=1.0),
        StateSpace("motor", A=[[-1 / lag]], B=[[1 / lag]], C=[[1.0]], inputs=[velocity("m")]),
        Spring("m", GROUND, stiffness=1.0),
        Damper("m", GROUND, damping=1.0),
        Force("m", 1.2 * output("motor")),
    )
    model = linearize(scene)
    assert model.eigenvalues[0].real == pytest.approx(1e-4, rel=1e-2)
    assert not model.stable


@pytest.mark.parametrize("count", [2, 3, 4, 5, 7, 8, 12])
def test_a_drive_line_that_turns_as_a_whole_has_no_frequency_for_that(count: int) -> None:
    """The squares of the frequencies are the eigenvalues of ``M^-1 K``, of which one is 0."""
    inertia, stiffness = 0.1 * np.arange(1, count + 1), 100.0 * np.arange(1, count)
    model = linearize(
        Scene(
            *(Body(f"b{i}", inertia=m, velocity=100.0) for i, m in enumerate(inertia.tolist())),
            *(Spring(f"b{i}", f"b{i + 1}", stiffness=k) for i, k in enumerate(stiffness.tolist())),
        )
    )
    K = np.zeros((count, count))
    for i, k in enumerate(stiffness.tolist()):
        K[i : i + 2, i : i + 2] += k * np.array([[1, -1], [-1, 1]])
    exact = np.sqrt(np.sort(np.linalg.eigvals(K / inertia[:, None]).real)[1:])
    np.testing.assert_allclose(np.sort(model.frequencies), exact, rtol=1e-9)
    assert model.stable


def test_a_normal_force_that_is_just_0_is_a_corner() -> None:
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Body("n", inertia=1.0),
        Contact("c", "m", GROUND, DryFriction(0.5, 0.4), normal=3 * position("n")),
        Spring("n", GROUND, stiffness=1.0),
    )
    with pytest.raises(ValueError, match="the normal force of contact 'c' is just 0"):
        linearize(scene)
    assert linearize(scene.replace("n", position=0.1)).A.shape == (3, 3)


@pytest.mark.parametrize("ratio", [0.7, 1.0, 1.3])
@pytest.mark.parametrize("speed", [0.3, 0.59, 1.0])
def test_a_normal_force_that_a_gear_keeps_at_0_is_a_corner(speed: float, ratio: float) -> None:
    """1.8 carrier = 2.8 ring - ratio sun = 0: in floats the carrier's velocity is roundoff of the others."""
    scene = Scene(
        Body("carrier", inertia=0.8),
        Body("sun", inertia=1.3, velocity=speed),
        Body("ring", inertia=1.05, velocity=speed * ratio / 2.8),
        Tie("gear", {"carrier": 1.8, "sun": ratio, "ring": -2.8}),
        Contact("c", "sun", GROUND, DryFriction(0.5, 0.4), normal=3 * velocity("carrier")),
        Spring("carrier", GROUND, stiffness=2.0),
    )
    with pytest.raises(ValueError, match="the normal force of contact 'c' is just 0"):
        linearize(scene)


@pytest.mark.parametrize("kind", ["saturated", "table", "gap"])
def test_a_normal_force_that_is_0_near_by_has_no_corner(kind: str) -> None:
    """Nothing presses the contact, here and near by: ``v' = -4 x``."""
    x = position("m")
    air = (
        Body("h", inertia=1.0, position=0.1),
        Gap("track", "h", GROUND, lower=0.0, stiffness=1e4, damping=20.0),
    )
    forces = {
        "saturated": saturate(5 * x, 0.0, 10.0),
        "table": table(x, [0.0, 1.0], [0.0, 10.0]),
        "gap": normal("track"),
    }
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0, position=-1.0),
        Spring("m", GROUND, stiffness=4.0),
        Contact("c", "m", GROUND, DryFriction(0.4, 0.35), normal=forces[kind]),
        *(air if kind == "gap" else ()),
    )
    found = linearize(scene)
    assert sorted(found.eigenvalues.imag)[:: len(found.eigenvalues) - 1] == pytest.approx([-2.0, 2.0], abs=1e-14)
    assert np.abs(found.eigenvalues.real).max() < 1e-14


def test_late() -> None:
    scene = Scene(Body("m", inertia=1.0), Spring("m", GROUND, stiffness=4.0))
    np.testing.assert_allclose(linearize(scene, t=1e11).frequencies, [2.0], rtol=1e-12)
