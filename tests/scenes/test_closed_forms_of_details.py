"""Details with closed forms that a wrong sign, side or level would change without being noticed elsewhere."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Mode,
    Result,
    Scene,
    Spring,
    explain,
    piecewise_linear,
    plots,
    simulate,
    sine,
    step,
)

ISOTROPIC = DryFriction(0.5, 0.5)
SIDED = DryFriction(0.6, 0.4, mu_static_backward=0.3, mu_coulomb_backward=0.2)
"""Forward levels 6 and 4, backward levels 3 and 2, at 10 N."""


def block(*loads: Any, law: DryFriction = ISOTROPIC, velocity: float = 0.0, **contact: Any) -> Scene:
    """A body of 1 kg on the ground, with loads."""
    forces = [Force("block", load) for load in loads]
    normal = contact.pop("normal", 10.0)
    body = Body("block", inertia=1.0, velocity=velocity)
    return Scene(body, Contact("pad", "block", GROUND, law, normal=normal, **contact), *forces)


def row(text: str, change: str) -> str:
    found = [line for line in text.splitlines() if change in line]
    assert len(found) == 1, text
    return found[0]


# Steps and outputs


@pytest.mark.parametrize(
    ("method", "formulation"),
    [
        ("BDF", "contact-force"),
        ("Adams", "contact-force"),
        ("BDF", "merged"),
        ("BDF", "multiplier"),
    ],
)
def test_no_step_is_longer_than_asked_for(method: str, formulation: str) -> None:
    """On a spring, with friction, x = 0.1 + 0.9 cos t: without `max_step` some steps are longer than 0.005 s."""
    scene = Scene(
        Body("block", inertia=1.0, position=1.0),
        Spring("block", GROUND, stiffness=1.0),
        Contact("pad", "block", GROUND, DryFriction(0.2, 0.1), normal=1.0),
    )
    options: dict[str, Any] = {"method": method, "formulation": formulation}
    free = simulate(scene, (0.0, 2.0), **options)
    assert np.diff(free.t).max() > 0.005
    short = simulate(scene, (0.0, 2.0), max_step=0.005, **options)
    assert np.diff(short.t).max() <= 0.005 * (1 + 1e-9)
    # from 1 towards 0.1, the point where the spring is as strong as friction: x = 0.1 + 0.9 cos t
    assert short.position("block") == pytest.approx(0.1 + 0.9 * np.cos(short.t), abs=1e-7)


@pytest.mark.parametrize("formulation", ["contact-force", "merged", "multiplier"])
def test_no_step_of_a_constant_deceleration_is_longer_than_asked_for(formulation: str) -> None:
    """From 4 m/s with 5 m/s^2: at rest at 0.8 s."""
    result = simulate(block(velocity=4.0), (0.0, 1.0), max_step=0.01, formulation=formulation)
    assert np.diff(result.t).max() <= 0.01 * (1 + 1e-9)
    assert [e.t for e in result.events] == pytest.approx([0.8], rel=1e-9)


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("dense", [True, False])
def test_output_times_are_the_results_own(parts: int, dense: bool) -> None:
    """Whoever reuses the array of times does not change what was computed: v = 4 - 5 t."""
    elements: list[Any] = []
    for k in range(parts):
        elements += [
            Body(f"block{k}", inertia=1.0, velocity=4.0),
            Contact(f"pad{k}", f"block{k}", GROUND, ISOTROPIC, normal=10.0),
        ]
    times = np.linspace(0.0, 0.7, 8)
    given = times.copy()
    result = simulate(Scene(*elements), (0.0, 0.7), t_eval=given, dense_output=dense)
    given[:] = -1.0
    assert result.t == pytest.approx(times, abs=0)
    assert result.velocity("block0") == pytest.approx(4.0 - 5.0 * times)
    assert result.force("pad0") == pytest.approx(5.0)


def test_outputs_at_an_event_are_the_limit_after_it() -> None:
    """At 0.8 s the block stops: the force falls from 5 (slipping) to 0 (held). At 2 s a push of 7 starts it."""
    push = step(2.0, after=7.0)
    times = [0.4, math.nextafter(0.8, 0), 0.8 + 1e-9, math.nextafter(2.0, 0), 2.0, 2.5]
    result = simulate(block(push, velocity=4.0), (0.0, 3.0), t_eval=times)
    stop, go = (e.t for e in result.events)
    assert (stop, go) == (pytest.approx(0.8, rel=1e-12), 2.0)
    assert result.force("pad") == pytest.approx([5.0, 5.0, 0.0, 0.0, 5.0, 5.0], abs=1e-12)
    assert result.mode("pad").tolist() == [1, 1, 0, 0, 1, 1]
    assert result.velocity("block") == pytest.approx([2.0, 0.0, 0.0, 0.0, 0.0, 1.0], abs=1e-8)


def test_outputs_at_a_located_event_are_the_limit_after_it() -> None:
    """Asked for at the very time of the event, and at the number just before."""
    scene = block(velocity=4.0)
    [event] = simulate(scene, (0.0, 3.0)).events
    times = [math.nextafter(event.t, 0), event.t]
    result = simulate(scene, (0.0, 3.0), t_eval=times)
    assert result.force("pad") == pytest.approx([5.0, 0.0], abs=1e-12)
    assert result.mode("pad").tolist() == [1, 0]


def test_the_last_output_is_the_limit_before_the_end() -> None:
    """A push of 7 that begins at the very end has moved nothing: 3 is held."""
    push = piecewise_linear([0.0, 1.0, 1.0, 2.0], [3.0, 3.0, 7.0, 7.0])
    for options in ({"t_eval": [0.5, 1.0]}, {}):
        result = simulate(block(push), (0.0, 1.0), **options)  # type: ignore[arg-type]
        assert not result.events
        assert result.force("pad")[-1] == pytest.approx(3.0)
        assert result.mode("pad")[-1] == Mode.STUCK


def test_every_event_stands_twice_without_output_times() -> None:
    """First the limit before it, then the limit after it, at one and the same time."""
    result = simulate(block(step(2.0, after=7.0), velocity=4.0), (0.0, 3.0))
    for t, force, mode in ((0.8, [5.0, 0.0], [1, 0]), (2.0, [0.0, 5.0], [0, 1])):
        at = np.flatnonzero(np.abs(result.t - t) < 1e-9)
        assert at.size == 2
        assert result.t[at[0]] == result.t[at[1]]
        assert result.force("pad")[at] == pytest.approx(force, abs=1e-12)
        assert result.mode("pad")[at].tolist() == mode


# Positions and scales


@pytest.mark.parametrize("periods", [0.25, 20.25, 20.5])
def test_position_of_a_drive_with_a_sine_for_velocity(periods: float) -> None:
    """The integral of sin(2 pi f t) is (1 - cos(2 pi f t)) / (2 pi f), however far apart the computed points are."""
    frequency = 1.0
    belt = Drive("belt", velocity=sine(1.0, frequency), position=2.0)
    # the belt slips under the block all the time, since the block is far faster: one parabola of 20 periods
    body = Body("block", inertia=1.0, velocity=100.0)
    scene = Scene(belt, body, Contact("pad", "block", "belt", DryFriction(0.1, 0.1), normal=1.0))
    result = simulate(scene, (0.0, periods / frequency))
    turn = 2 * math.pi * frequency
    assert result.position("belt")[-1] == pytest.approx(2 + (1 - math.cos(turn * result.t[-1])) / turn, rel=1e-8)
    end = float(result.t[-1])
    assert result.position("block")[-1] == pytest.approx(100 * end - 0.05 * end**2, rel=1e-12)


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e-9])
@pytest.mark.parametrize("at", ["rest", "position"])
def test_half_a_swing_takes_pi_in_whatever_unit_it_is_stretched(scale: float, at: str) -> None:
    """Unit mass on a unit spring, let go with a stretch of `scale`: with dry friction too, it turns after pi seconds.

    The stretch sets the scale, not the position: a rest length of `scale` at position 0 gives the mirrored motion.
    """
    law = DryFriction(0.1, 0.1)
    stretch = {"rest": scale} if at == "rest" else {}
    scene = Scene(
        Body("block", inertia=1.0, position=0.0 if at == "rest" else scale),
        Spring("block", GROUND, stiffness=1.0, **stretch),
        Contact("pad", "block", GROUND, law, normal=scale),
    )
    result = simulate(scene, (0.0, 4.0))
    turns = [e.t for e in result.events if e.after != e.before and e.t > 1.0]
    assert turns[0] == pytest.approx(math.pi, abs=1e-6)


# Levels


def test_breakaway_with_a_kinetic_curve_rises_from_the_curve_at_rest() -> None:
    """mu_k(0) = 0.3 is above mu_coulomb = 0.1: B rises from 3 N, not from 1 N, and slow slip costs 3 N.

    From 2 m/s with 3 m/s^2: at rest at 2/3 s; then B = 5 - (5 - 3) exp(-(t - 2/3) / 0.5).
    """
    law = DryFriction(0.5, 0.1, dwell=0.5, kinetic=lambda speed: 0.3)
    times = np.array([0.0, 0.3, 0.6, 0.7, 1.0, 1.5, 2.5])
    result = simulate(block(law=law, velocity=2.0), (0.0, 3.0), t_eval=times)
    stuck = times > 2 / 3
    rising = 5.0 - 2.0 * np.exp(-(times - 2 / 3) / 0.5)
    assert result.breakaway("pad") == pytest.approx(np.where(stuck, rising, 3.0), rel=1e-7)
    assert result.force("pad") == pytest.approx(np.where(stuck, 0.0, 3.0), abs=1e-9)


@pytest.mark.parametrize(("sign", "level"), [(1, 6.0), (-1, 3.0)])
def test_breakaway_of_an_anisotropic_contact_while_it_slips(sign: int, level: float) -> None:
    """Without a dwell time it would be stuck at the static level of the side to which it slips."""
    result = simulate(block(law=SIDED, velocity=10.0 * sign), (0.0, 1.0), t_eval=[0.0, 0.5, 1.0])
    assert result.mode("pad").tolist() == [sign] * 3
    assert result.breakaway("pad") == pytest.approx(level)


@pytest.mark.parametrize(("sign", "level"), [(1, 4.0), (-1, 2.0)])
def test_breakaway_of_an_anisotropic_contact_with_dwell_while_it_slips(sign: int, level: float) -> None:
    """With a dwell time it would be stuck at the Coulomb level of that side first."""
    law = DryFriction(0.6, 0.4, dwell=1.0, mu_static_backward=0.3, mu_coulomb_backward=0.2)
    result = simulate(block(law=law, velocity=10.0 * sign), (0.0, 1.0), t_eval=[0.0, 0.5, 1.0])
    assert result.breakaway("pad") == pytest.approx(level)


def test_breakaway_of_an_anisotropic_contact_while_it_is_stuck() -> None:
    """The level is that of the side to which the load pushes: 6 where it pushes forward, 3 where backward."""
    push = piecewise_linear([0.0, 2.0], [-2.0, 2.0])
    times = np.array([0.0, 0.5, 0.9, 1.1, 1.5, 2.0])
    result = simulate(block(push, law=SIDED), (0.0, 2.0), t_eval=times)
    assert not result.events
    assert result.force("pad") == pytest.approx(2.0 * (times - 1.0))
    assert result.breakaway("pad") == pytest.approx(np.where(times < 1.0, 3.0, 6.0))


def test_breakaway_of_an_anisotropic_contact_rises_on_its_side() -> None:
    """Pushed backward with 1: B = 3 - exp(-t); pushed forward: B = 6 - 2 exp(-t)."""
    law = DryFriction(0.6, 0.4, dwell=1.0, mu_static_backward=0.3, mu_coulomb_backward=0.2)
    times = np.array([0.0, 0.5, 2.0])
    for push, static, fall in ((-1.0, 3.0, 1.0), (1.0, 6.0, 2.0)):
        result = simulate(block(push, law=law), (0.0, 2.0), t_eval=times)
        assert result.breakaway("pad") == pytest.approx(static - fall * np.exp(-times))


@pytest.mark.parametrize(("slope", "expected"), [(1.0, 6.0), (-1.0, 3.0)])
def test_an_anisotropic_contact_breaks_away_at_the_level_of_its_side(slope: float, expected: float) -> None:
    """A push that grows by 1 N/s overcomes 6 N forward after 6 s, 3 N backward after 3 s."""
    push = piecewise_linear([0.0, 10.0], [0.0, 10.0 * slope])
    [event] = simulate(block(push, law=SIDED), (0.0, 10.0)).events
    assert event.t == pytest.approx(expected, rel=1e-10)
    assert event.after == math.copysign(1, slope)


def test_a_level_that_rises_late_is_overtaken_for_a_moment() -> None:
    """N = 1 + 10 t, so B = (1 + 10 t) (0.5 - 0.4 exp(-t)); the push 0.095 + 1.8 t is larger from 0.0145 to 0.0961 s."""

    def reserve(t: float) -> float:
        return (1 + 10 * t) * (0.5 - 0.4 * math.exp(-t)) - (0.095 + 1.8 * t)

    assert reserve(0.0) > 0 > reserve(0.05) and reserve(0.1) > 0
    push = piecewise_linear([0.0, 2.0], [0.095, 3.695])
    normal = piecewise_linear([0.0, 2.0], [1.0, 21.0])
    result = simulate(block(push, law=DryFriction(0.5, 0.1, dwell=1.0), normal=normal), (0.0, 2.0))
    first = result.events[0]
    assert first.t == pytest.approx(brentq(reserve, 0.0, 0.05, xtol=1e-15), rel=1e-7)
    assert (first.before, first.after) == (Mode.STUCK, Mode.FORWARD)


@pytest.mark.parametrize("formulation", ["contact-force", "merged", "multiplier"])
def test_the_work_of_the_solver_is_counted(formulation: str) -> None:
    """A swing on a spring takes steps, and each of them at least one evaluation of the rates."""
    scene = Scene(Body("block", inertia=1.0, position=1.0), Spring("block", GROUND, stiffness=1.0))
    result = simulate(scene, (0.0, 10.0), formulation=formulation)
    assert result.stats["steps"] >= 10
    assert result.nfev >= result.stats["steps"]


# What is refused, said and drawn


def test_a_kinetic_curve_is_limited_by_the_smaller_static_coefficient() -> None:
    """It holds for both directions, so at rest it may exceed neither; the message names the one that it exceeds."""

    def curve(speed: float) -> float:
        return 0.3

    with pytest.raises(ValueError, match=r"kinetic\(0\) = 0.3 .* mu_static_backward = 0.2"):
        DryFriction(0.5, 0.1, mu_static_backward=0.2, mu_coulomb_backward=0.1, kinetic=curve)
    with pytest.raises(ValueError, match=r"kinetic\(0\) = 0.3 .* mu_static = 0.2"):
        DryFriction(0.2, 0.1, mu_static_backward=0.5, mu_coulomb_backward=0.1, kinetic=curve)
    with pytest.raises(ValueError, match=r"kinetic\(0\) = 0.3 .* mu_static = 0.2"):
        DryFriction(0.2, 0.1, kinetic=curve)
    sided = DryFriction(0.5, 0.1, mu_static_backward=0.3, mu_coulomb_backward=0.1, kinetic=curve)
    assert sided.mu_k(1.0, -1) == 0.3


@pytest.mark.parametrize(("sign", "level"), [(1, "3"), (-1, "6")])
def test_a_reversal_is_explained_by_the_level_of_the_side_to_which_it_went(sign: int, level: str) -> None:
    """A push of 8 turns the block round at w = 0: it exceeds 3, the level backward, and 6, the level forward."""
    result = simulate(block(-8.0 * sign, law=SIDED, velocity=3.0 * sign), (0.0, 1.0))
    before, after = ("FORWARD", "BACKWARD") if sign > 0 else ("BACKWARD", "FORWARD")
    # with the push and friction against it: 3 m/s over 8 + 4 or 8 + 2 m/s^2
    [event] = result.events
    assert event.t == pytest.approx(3.0 / (12.0 if sign > 0 else 10.0), rel=1e-9)
    assert f"more than the {level} it could hold" in row(explain(result), f"{before} -> {after}")


def _law_lines(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """The law's curve backward and forward of a drawn characteristic: all lines drawn behind the trajectory."""
    ax = plots.characteristic(result, "pad")
    trajectory = next(line for line in ax.get_lines() if line.get_label() == "trajectory")
    behind = [line for line in ax.get_lines() if line.get_zorder() < trajectory.get_zorder()]
    points = np.concatenate([np.column_stack(line.get_data()) for line in behind if len(line.get_xdata())])
    return points[points[:, 0] < 0, 1], points[points[:, 0] > 0, 1]


@pytest.mark.parametrize(("normal", "factor"), [(10.0, 10.0), (piecewise_linear([0.0, 10.0], [10.0, 20.0]), 1.0)])
def test_the_drawn_law_is_that_of_the_motion(normal: Any, factor: float) -> None:
    """Coefficients 0.4 forward and 0.2 backward, times 10 N; per normal force where that varies."""
    result = simulate(block(-12.0, law=SIDED, velocity=6.0, normal=normal), (0.0, 2.0))
    assert set(result.mode("pad").tolist()) == {1, -1}
    backward, forward = _law_lines(result)
    assert forward == pytest.approx(0.4 * factor)
    assert backward == pytest.approx(-0.2 * factor)


# Between the computed points, and the account


def test_states_are_read_within_the_span_only() -> None:
    """One time outside is enough to be refused, whatever the others are."""
    result = simulate(block(velocity=4.0), (0.0, 1.0))
    assert result([0.0, 0.4, 1.0])[0] == pytest.approx([4.0, 2.0, 0.0], abs=1e-9)
    for times in ([0.5, 1.1], [-0.1, 0.5], [-0.1, 1.1]):
        with pytest.raises(ValueError, match=rf"times must lie in \[0, 1\] s, got {times[0]:g} to {times[1]:g}"):
            result(times)


def test_the_account_is_that_of_the_last_time() -> None:
    """A belt at 2 m/s takes a block along with 5 N: at 0.4 s they run together.

    The belt has then done 5 * 2 * 0.4 = 4 J, half of which is heat. A second body is slowed by a damper alone:
    its energy is exp(-2 t) / 2. A third is pushed with 3 N over 3/2 t^2 m, and a fourth swings on a spring.
    """
    scene = Scene(
        Drive("belt", velocity=2.0),
        Body("block", inertia=1.0),
        Contact("pad", "block", "belt", ISOTROPIC, normal=10.0),
        Body("slowed", inertia=1.0, velocity=1.0),
        Damper("slowed", GROUND, damping=1.0),
        Body("pushed", inertia=1.0),
        Force("pushed", 3.0),
        Body("swinging", inertia=1.0, position=1.0),
        Spring("swinging", GROUND, stiffness=1.0),
    )
    result = simulate(scene, (0.0, 2.0))
    account = result.energy()
    left = 0.5 * math.exp(-4.0)
    expected = {
        "kinetic": 2.0 + left + 18.0 + 0.5 * math.sin(2.0) ** 2,
        "springs": 0.5 * math.cos(2.0) ** 2,
        "work of loads": 18.0,
        "work of drives": 4.0,
        "heat of contact 'pad'": 2.0,
        "heat of damper": 0.5 - left,
        "balance error": 0.0,
    }
    lines = str(account).splitlines()
    assert lines[0] == "energy in J at 2 s (at the start 1 stored)"
    assert len(lines) == 1 + len(expected)
    for line, (name, value) in zip(lines[1:], expected.items(), strict=True):
        assert line.strip().startswith(name)
        assert float(line.split()[-1]) == pytest.approx(value, abs=1e-6)
    stuck = result.t > 0.4 + 1e-9
    assert account.contacts["pad"][stuck] == pytest.approx(2.0)
    assert account.drives[stuck] == pytest.approx(4.0)


def test_work_of_a_belt_that_swings_between_far_apart_points() -> None:
    """The block is far faster than the belt, so friction is 0.1 all the time, and pushes the belt forward.

    The belt moves at sin(2 pi t) m/s: its drive takes up 0.1 N over (1 - cos(2 pi t)) / (2 pi) m.
    """
    belt = Drive("belt", velocity=sine(1.0, 1.0))
    body = Body("block", inertia=1.0, velocity=100.0)
    scene = Scene(belt, body, Contact("pad", "block", "belt", DryFriction(0.1, 0.1), normal=1.0))
    times = np.array([0.25, 10.5, 20.25])
    account = simulate(scene, (0.0, 20.25), t_eval=times).energy()
    way = (1.0 - np.cos(2 * math.pi * times)) / (2 * math.pi)
    assert account.drives == pytest.approx(-0.1 * way, rel=1e-7)
    assert account.contacts["pad"] == pytest.approx(0.1 * (100 * times - 0.05 * times**2 - way), rel=1e-9)


# Open contacts


@pytest.mark.parametrize("push", [-2.0, 0.0, 2.0])
def test_an_open_contact_at_rest_goes_where_its_bodies_go(push: float) -> None:
    """The normal force is 0, so the mode is the sign of the acceleration to come; 0 is stuck."""
    result = simulate(block(push, normal=piecewise_linear([0.0, 1.0, 2.0], [0.0, 0.0, 10.0])), (0.0, 1.0))
    assert set(result.mode("pad").tolist()) == {int(np.sign(push))}
    assert result.force("pad") == pytest.approx(0.0, abs=0)
    assert result.velocity("block") == pytest.approx(push * result.t)


@pytest.mark.parametrize("rest", [1e-9, 3e-13])
@pytest.mark.parametrize("options", [{"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}])
def test_a_motion_is_resolved_that_only_the_rest_length_of_a_spring_tells(options: dict[str, Any], rest: float) -> None:
    """x = rest (1 - cos t): the open contact turns at pi and 2 pi, however small the velocities are."""
    scene = Scene(
        Body("b", inertia=1.0),
        Spring("b", GROUND, stiffness=1.0, rest=rest),
        Contact("open", "b", GROUND, DryFriction(0.3, 0.2), normal=0.0),
    )
    result = simulate(scene, (0.0, 5.0), **options)
    (event,) = result.events
    assert event.t == pytest.approx(math.pi, abs=1e-5)
    late = result.sample([1.0, 4.0])
    np.testing.assert_allclose(late.velocity("b"), rest * np.sin(late.t), rtol=0, atol=1e-6 * rest)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_breakaway_with_a_kinetic_curve_comes_when_the_load_meets_the_risen_level(
    options: dict[str, Any],
) -> None:
    """From rest under 2 + 2 t: B = 5 - (5 - 3) exp(-2 t), not 5 - (5 - 1) exp(-2 t), which starts below the load."""
    law = DryFriction(0.5, 0.1, dwell=0.5, kinetic=lambda speed: 0.3)
    load = piecewise_linear([0.0, 4.0], [2.0, 10.0])
    scene = Scene(Body("block", inertia=1.0), Contact("pad", "block", GROUND, law, normal=10.0), Force("block", load))
    (event,) = simulate(scene, (0.0, 2.0), **options).events
    exact = brentq(lambda t: 5.0 - 2.0 * math.exp(-2.0 * t) - 2.0 - 2.0 * t, 0.5, 2.0)
    assert event.t == pytest.approx(exact, abs=1e-7) and exact == pytest.approx(1.4443517, abs=1e-7)
