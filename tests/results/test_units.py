"""Units of bodies and of what joins them, where a scene, its bodies, both or neither say how they move."""

import csv
from pathlib import Path

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
    Planetary,
    Scene,
    Spring,
    Tie,
    output,
    simulate,
)
from stickslip.results.units import units
from stickslip.studies.scene_sweep import SceneRuns

GRIP = DryFriction(0.9, 0.8)

LINE = Scene(
    Body("engine", inertia=0.2, velocity=100.0, motion="rotation"),
    Body("wheel", inertia=1.0, motion="rotation"),
    Body("car", inertia=300.0, motion="translation"),
    Contact("clutch", "engine", "wheel", DryFriction(0.3, 0.25), normal=100.0),
    Contact("tyre", "wheel", "car", GRIP, normal=3000.0, radius_a=0.3),
    Contact("bearing", "wheel", GROUND, DryFriction(0.1, 0.1), normal=1.0),
    Contact("rim brake", "wheel", GROUND, DryFriction(0.1, 0.1), normal=1.0, radius_a=0.2),
    Spring("engine", GROUND, stiffness=1.0),
    Damper("car", GROUND, damping=3.0),
    Force("engine", 20.0),
    Force("car", -5.0),
)
"""A wheel that rotates and a car that moves along a line."""


def unit_of(scene: Scene, name: str) -> str:
    return units(scene, next(row for row in scene.rows if row.name == name)).force


def test_a_body_says_how_it_moves_and_contacts_follow() -> None:
    engine, wheel, car = LINE.bodies
    assert [units(LINE, one).velocity for one in (engine, wheel, car)] == ["rad/s", "rad/s", "m/s"]
    assert units(LINE, engine, wheel).velocity == "rad/s"
    assert units(LINE).velocity == "m/s | rad/s"
    forces = {"clutch": "N m", "tyre": "N", "bearing": "N m", "rim brake": "N"}
    assert {name: unit_of(LINE, name) for name in forces} == forces
    assert units(LINE, LINE.springs[0]).stiffness == "N m/rad"
    assert units(LINE, LINE.dampers[0]).damping == "N s/m"
    assert [units(LINE, force).force for force in LINE.forces] == ["N m", "N"]


def test_the_word_of_a_body_counts_before_that_of_the_scene() -> None:
    scene = Scene(Body("wheel", inertia=1.0), Drive("belt", velocity=1.0, motion="translation"), motion="rotation")
    assert scene.motions == {"wheel": "rotation", "belt": "translation"}
    assert Scene.from_dict(scene.to_dict()) == scene
    assert scene.replace("wheel", motion="translation").motions["wheel"] == "translation"
    with pytest.raises(ValueError, match=r"body 'a': motion must be 'rotation' or 'translation', got 'linear'"):
        Body("a", inertia=1.0, motion="linear")  # type: ignore[arg-type]


def test_ties_have_the_unit_of_the_member_their_force_acts_on() -> None:
    bodies = [Body(name, inertia=1.0, motion="rotation") for name in ("sun", "arm", "ring")]
    rack = Body("rack", inertia=1.0, motion="translation")
    planetary = Planetary("planetary", sun="sun", carrier="arm", ring="ring", ratio=2.0)
    pinion, back = Gear("pinion", "sun", "rack", ratio=10.0), Gear("back", "rack", "sun", ratio=0.1)
    rolling, scaled = Tie("rolling", {"sun": 0.1, "rack": -1.0}), Tie("scaled", {"arm": 2.0, "ring": -3.0})
    scene = Scene(*bodies, rack, planetary, pinion, scaled)
    assert [units(scene, tie).force for tie in (planetary, pinion, scaled)] == ["N m", "N m", "N m"]
    assert [units(scene, tie).force for tie in (back, rolling)] == ["N", "N"]


def test_what_no_one_says_has_both_units() -> None:
    scene = Scene(Body("a", inertia=1.0), Body("b", inertia=1.0), Contact("c", "a", "b", GRIP, normal=1.0))
    assert not units(scene).known and unit_of(scene, "c") == "N | N m"
    # a row between a body that moves along a line and one that does not say is measured along the line
    assert unit_of(scene.replace("a", motion="translation"), "c") == "N"
    assert unit_of(scene.replace("a", motion="rotation"), "c") == "N | N m"


def test_tables_explanations_and_figures_name_the_units_of_each(tmp_path: Path) -> None:
    result = simulate(LINE, (0.0, 5.0))
    result.to_csv(tmp_path / "line.csv")
    with (tmp_path / "line.csv").open(newline="", encoding="utf-8") as file:
        heads = next(csv.reader(file))
    assert {"velocity wheel [rad/s]", "velocity car [m/s]", "force clutch [N m]", "force tyre [N]"} <= set(heads)
    assert output.column_units(result)["position engine"] == "rad"

    clutch, rim_brake = (
        next(line for line in result.explain().splitlines() if f" {name} " in line and " s  " in line)
        for name in ("clutch", "rim brake")
    )
    assert clutch.endswith(" [N m, rad/s]") and rim_brake.endswith(" [N, m/s]")
    figure = result.plot()
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert labels[:2] == ["velocity [rad/s]", "velocity [m/s]"]
    assert "force [N m]" in labels and "force [N]" in labels
    drawn = {text.get_text() for text in LINE.draw().axes[0].texts}
    assert {"wheel: 1 kg m²", "car: 300 kg", "k = 1 N m/rad", "c = 3 N s/m", "F = 20 N m"} <= drawn


def test_one_axes_for_all_bodies_names_the_unit_of_each() -> None:
    from stickslip.plots import velocities

    ax = velocities(simulate(LINE, (0.0, 1.0)))
    assert ax.get_ylabel() == "velocity [m/s | rad/s]"
    shown = {line.get_label() for line in ax.lines}
    assert {"wheel [rad/s]", "car [m/s]"} <= shown


def test_parameters_have_the_unit_of_their_element() -> None:
    runs = SceneRuns(LINE, (0.0, 1.0), {})
    expected = {
        "wheel.inertia": "kg m²",
        "car.inertia": "kg",
        "car.velocity": "m/s",
        "tyre.normal": "N",
        "clutch.normal": "N",
        "clutch.law.dwell": "s",
        "springs[0].stiffness": "N m/rad",
        "dampers[0].damping": "N s/m",
        "forces[0].signal": "N m",
        "clutch.law.mu_static": "",
        "velocity car": "m/s",
        "heat tyre": "J",
        "events": "",
    }
    assert {name: runs.unit(name) for name in expected} == expected
