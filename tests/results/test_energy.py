"""The energy ledger balances, and its parts are those of hand calculation."""

import math
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gear,
    OneWay,
    PreSlip,
    Scene,
    Spring,
    Stop,
    join,
    simulate,
    sine,
    step,
    triangle,
)
from stickslip.benchmark import flywheel_benchmark
from stickslip.results import samples
from stickslip.results.energy import energy
from stickslip.results.samples import Samples
from stickslip.results.trajectory import Trajectory
from validation.exact import REFERENCES, reference

DRY = DryFriction(0.2, 0.1)


@pytest.mark.parametrize("name", REFERENCES)
def test_reference_scenes_balance(name):
    story = reference(name)
    result = simulate(story.scene, (0.0, story.stop), rtol=1e-11, atol=1e-13)
    ledger = energy(result)
    assert ledger.relative_error < 1e-9
    assert ledger.error.shape == result.t.shape
    assert all(np.diff(heat).min() >= -1e-12 for heat in ledger.contacts.values())


@pytest.mark.parametrize("name", ["flywheels-2", "flywheels-4", "star"])
def test_motion_without_springs_and_dampers_balances_to_roundoff(name):
    story = reference(name)
    assert energy(simulate(story.scene, (0.0, story.stop))).relative_error < 1e-14


def test_a_sliding_block_turns_its_energy_to_heat():
    scene = Scene(Body("block", inertia=2.0, velocity=3.0), Contact("floor", "block", GROUND, DRY, normal=10.0))
    result = simulate(scene, (0.0, 10.0))
    ledger = energy(result)
    assert ledger.kinetic[0] == 9.0
    assert ledger.kinetic[-1] == 0.0
    assert ledger.contacts["floor"][-1] == pytest.approx(9.0, rel=1e-14)
    assert ledger.spring.max() == ledger.loads.max() == ledger.drives.max() == 0.0
    assert ledger.dampers == {}
    assert ledger.contacts["floor"][ledger.t >= 6.0 - 1e-12] == pytest.approx(9.0, rel=1e-14)


def test_work_of_a_force_on_a_free_body():
    scene = Scene(Body("block", inertia=2.0), Force("block", triangle(1.0, 2.0, 3.0, slope=4.0)))
    ledger = energy(simulate(scene, (0.0, 5.0)))
    # impulse 4 N s on 2 kg: 2 m/s
    assert ledger.loads[-1] == pytest.approx(4.0, rel=1e-14)
    assert ledger.kinetic[-1] == pytest.approx(4.0, rel=1e-14)


def test_a_belt_pays_for_the_heat_and_the_speed():
    scene = Scene(
        Body("block", inertia=1.0),
        Drive("belt", velocity=2.0),
        Contact("c", "block", "belt", DRY, normal=10.0),
    )
    ledger = energy(simulate(scene, (0.0, 5.0)))
    assert ledger.drives[-1] == pytest.approx(4.0, rel=1e-12)
    assert ledger.contacts["c"][-1] == pytest.approx(2.0, rel=1e-12)
    swapped = Scene(
        Body("block", inertia=1.0),
        Drive("belt", velocity=2.0),
        Contact("c", "belt", "block", DRY, normal=10.0),
    )
    assert energy(simulate(swapped, (0.0, 5.0))).drives[-1] == pytest.approx(4.0, rel=1e-12)


def test_a_drive_works_through_springs_and_dampers():
    scene = Scene(
        Body("block", inertia=1.5),
        Drive("shaker", velocity=sine(1.0, 0.7, offset=0.2)),
        Spring("shaker", "block", stiffness=3.0, damping=0.2, rest=0.1),
        Damper("block", "shaker", damping=0.4),
        Damper("block", "shaker", damping=0.1),
        Damper("block", GROUND, damping=0.0),
    )
    ledger = energy(simulate(scene, (0.0, 6.0), rtol=1e-11, atol=1e-13))
    assert ledger.relative_error < 1e-9
    assert list(ledger.dampers) == [
        "spring 'shaker'-'block'",
        "damper 'block'-'shaker'",
        "damper 'block'-'shaker' #2",
    ]
    first, second = ledger.dampers["damper 'block'-'shaker'"], ledger.dampers["damper 'block'-'shaker' #2"]
    assert first[-1] == pytest.approx(4 * second[-1], rel=1e-12)
    assert ledger.spring[0] == pytest.approx(0.5 * 3.0 * 0.1**2)
    assert ledger.drives[-1] > 0


def test_a_damper_takes_what_the_relative_speed_had():
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Body("b", inertia=1.0), Damper("a", "b", damping=2.0))
    ledger = energy(simulate(scene, (0.0, 1.0), rtol=1e-11, atol=1e-13))
    assert ledger.dampers["damper 'a'-'b'"][-1] == pytest.approx(0.25 * -math.expm1(-8.0), rel=1e-9)


def test_requested_times_and_computed_points_give_the_same_ledger():
    scene = reference("two-blocks").scene
    times = np.linspace(0.0, 20.0, 7)
    few = energy(simulate(scene, (0.0, 20.0), t_eval=times))
    all_points = simulate(scene, (0.0, 20.0))
    whole = energy(all_points)
    assert few.t is not whole.t and few.t.size == 7
    assert few.drives[-1] == pytest.approx(whole.drives[-1], rel=1e-12)
    assert few.heat[-1] == pytest.approx(whole.heat[-1], rel=1e-12)
    assert few.relative_error < 1e-6


def test_regularized_contacts_balance():
    scene = flywheel_benchmark(PreSlip(DryFriction(0.2, 0.1), velocity=1e-2, shape="tanh"))
    ledger = energy(simulate(scene, (0.0, 1.0), rtol=1e-10, atol=1e-12))
    assert ledger.relative_error < 1e-7


def test_fixed_steps_show_their_error():
    story = reference("pulled-block")
    errors = [
        energy(simulate(story.scene, (0.0, 12.0), method="Euler", step=step)).relative_error for step in (0.02, 0.01)
    ]
    # the method is of first order
    assert 1e-5 < errors[1] < errors[0] < 0.1
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)


def test_without_dense_output_there_is_a_remedy():
    result = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=[0.0, 0.5, 1.0], dense_output=False)
    with pytest.raises(ValueError, match="simulate with dense_output=True"):
        energy(result)


def test_the_account_prints():
    text = str(energy(simulate(flywheel_benchmark(), (0.0, 4.0))))
    assert text.startswith("energy in J at 4 s (at the start 5.6005 stored)")
    assert "heat of contact 'brake'" in text
    assert text.splitlines()[-1].split()[:2] == ["balance", "error"]


def test_a_still_scene_has_no_error():
    scene = Scene(Body("block", inertia=1.0), Contact("floor", "block", GROUND, DRY, normal=1.0))
    assert energy(simulate(scene, (0.0, 1.0))).relative_error == 0.0


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("stiffness", [0.0, 1e3])
def test_velocities_of_roundoff_are_no_motion(options: dict[str, Any], stiffness: float):
    # these forces add up to 6e-17 N, which the series takes for nothing where a spring lets it look
    # further ahead; a body without inertia has no energy
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0),
        Body("wheel", inertia=0.0),
        Gear("gear", "wheel", "b", ratio=2.0),
        *[Spring("a", "b", stiffness=stiffness)] * (stiffness > 0),
        *(Force("b", force) for force in (0.1, 0.2, -0.3)),
    )
    ledger = energy(simulate(scene, (0.0, 10.0), **options))
    assert np.abs(ledger.stored).max() < 1e-28
    assert ledger.stored.any() == bool(options or not stiffness)
    assert ledger.relative_error < 1e-2
    assert "at the start 0 stored" in str(ledger)


@pytest.mark.parametrize("speed", [1e-9, 1e-5, 1.0])
def test_small_energies_are_no_roundoff(speed: float):
    scene = Scene(
        Body("a", inertia=1.0, velocity=speed),
        Body("b", inertia=1.0),
        Spring("a", "b", stiffness=1e3),
        Contact("floor", "b", GROUND, DRY, normal=1e3),
        Force("b", 100.0),
    )
    # b is held; each step of Euler's method adds ``h^2 k / m`` to the energy
    ledger = energy(simulate(scene, (0.0, 1.0), method="Euler", step=1e-4))
    assert ledger.relative_error > 1e-2
    assert ledger.stored[-1] == pytest.approx(0.5 * speed**2 * (1 + 1e-8 * 1e3) ** 10_000, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("options", [{}, {"method": "BDF", "rtol": 1e-10, "atol": 1e-12}])
def test_the_work_on_what_rides_on_a_swinging_drive(options: dict[str, Any]) -> None:
    """No state moves for itself, so steps are long beside the period 0.2 s; x = 0.05/pi (1 - cos(10 pi t))."""
    # the drive's acceleration, up to 15.7 m/s2, and the load need 34 N at most: less than the 60 N that hold it
    scene = Scene(
        Body("b", inertia=2.0),
        Drive("d", velocity=sine(0.5, 5.0)),
        Contact("c", "b", "d", DryFriction(0.6, 0.5), normal=100.0),
        Force("b", 3.0),
    )
    t = np.linspace(0.0, 1.7, 35)
    result = simulate(scene, (0.0, 1.7), t_eval=t, **options)
    assert result.events == []
    ledger = result.energy()
    way, speed = 0.05 / np.pi * (1 - np.cos(10 * np.pi * t)), 0.5 * np.sin(10 * np.pi * t)
    np.testing.assert_allclose(ledger.loads, 3.0 * way, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ledger.drives, speed**2 - 3.0 * way, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ledger.kinetic, speed**2, rtol=0, atol=1e-12)
    assert ledger.relative_error < 1e-12


def test_an_impact_at_the_very_start_is_in_the_ledger() -> None:
    """A ball on a rising table: the table does work by the impulse, the impact takes 3/4 of the relative energy."""
    table = Drive("table", velocity=0.5)
    stop = Stop("contact", "ball", "table", lower=0.0, restitution=0.5)
    ledger = simulate(Scene(Body("ball", inertia=1.0, velocity=-2.0), table, stop), (0.0, 1.0)).energy()
    # from -2.5 m/s to 1.25 m/s beside the table
    assert ledger.impacts["contact"] == pytest.approx(0.5 * 2.5**2 * 0.75)
    assert ledger.drives == pytest.approx(3.75 * 0.5)
    assert ledger.begun == pytest.approx(2.0) and "at the start 2 stored" in str(ledger)
    assert np.abs(ledger.error).max() < 1e-14


def test_an_impact_between_two_runs_is_no_change_from_outside() -> None:
    scene = Scene(
        Body("ball", inertia=1.0, position=1.0),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=0.5),
        Force("ball", -9.81),
    )
    whole = simulate(scene, (0.0, 1.0))
    first = simulate(scene, (0.0, whole.events[0].t))
    both = join([first, simulate(first.final_scene(), (first.t[-1], 1.0))])
    assert [event.cause for event in both.events] == ["impact", "impact"]
    assert not both.energy().changes.any()
    assert both.energy().impacts["floor"][-1] == pytest.approx(whole.energy().impacts["floor"][-1], rel=1e-12)


def test_many_times_in_one_piece_are_integrated_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    # ten thousand times of a thousand bodies would not fit into memory at once
    scene = Scene(
        Body("a", inertia=1.0, velocity=3.0), Contact("floor", "a", GROUND, DryFriction(0.5, 0.4), normal=5.0)
    )
    result = simulate(scene, (0.0, 2.0), t_eval=np.linspace(0.0, 2.0, 200))
    whole = result.energy()
    asked: list[int] = []

    def counted(trajectory: Trajectory, piece_of: np.ndarray, taus: np.ndarray) -> Samples:
        asked.append(taus.size)
        return at_local(trajectory, piece_of, taus)

    at_local = Samples.at_local
    monkeypatch.setattr(Samples, "at_local", counted)
    monkeypatch.setattr(samples, "_VALUES_AT_ONCE", 500)
    parts = energy(result.sample(result.t))
    assert len(asked) > 10 and max(asked) < 100
    # closed form: v = 3 - 2 t until 1.5 s, the heat is what the body loses
    v = np.maximum(3.0 - 2.0 * result.t, 0.0)
    for ledger in (whole, parts):
        np.testing.assert_allclose(ledger.contacts["floor"], 4.5 - 0.5 * v**2, rtol=0, atol=1e-14)


def test_a_blow_that_closes_a_clutch_takes_from_both() -> None:
    """2 kg come back from a stop with half of their 2 m/s, and meet 1 kg that follows with 1 m/s: both have -1/3."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=2.0, velocity=2.0),
        OneWay("clutch", "a", "b"),
        Stop("stop", "b", GROUND, upper=1.0, restitution=0.5),
    )
    result = simulate(scene, (0.0, 1.0))
    assert result.velocity("a")[-1] == result.velocity("b")[-1] == pytest.approx(-1 / 3, rel=1e-14)
    ledger = result.energy()
    assert ledger.impacts["stop"][-1] == pytest.approx(0.5 * 2.0 * (4.0 - 1.0), rel=1e-14)
    assert ledger.impacts["clutch"][-1] == pytest.approx(0.5 * (1.0 + 2.0 - 3.0 / 9.0), rel=1e-14)
    assert ledger.relative_error < 1e-14


def test_a_ram_works_with_its_new_velocity_where_one_blow_follows_another() -> None:
    """The ram jumps from 0 to 1 m/s. It brings 1 kg from rest to 1 m/s at the mean velocity 1/2 m/s: 1/2 J.

    Then it brings 2 kg from 0.5 to 1 m/s at its new velocity: 1 J.
    """
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0, velocity=0.5),
        Drive("ram", velocity=step(1.0, 0.0, 1.0)),
        OneWay("clutch", "a", "b"),
        Stop("face", "a", "ram", lower=0.0),
    )
    result = simulate(scene, (0.0, 2.0))
    assert result.velocity("a")[-1] == result.velocity("b")[-1] == pytest.approx(1.0, rel=1e-14)
    ledger = result.energy()
    assert ledger.drives[-1] == pytest.approx(0.5 + 1.0, rel=1e-14)
    assert ledger.impacts["clutch"][-1] == pytest.approx(0.5 * 1.0 * 0.5, rel=1e-14)
    assert ledger.relative_error < 1e-14
