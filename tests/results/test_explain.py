"""Explanations say what was assembled, and give each event its numbers."""

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gear,
    Karnopp,
    LuGre,
    OneWay,
    PreSlip,
    Scene,
    Spring,
    StateSpace,
    Stop,
    When,
    feedback,
    output,
    pid,
    piecewise_linear,
    position,
    power,
    simulate,
    sine,
    step,
    table,
    velocity,
)
from stickslip.benchmark import flywheel_benchmark, flywheel_chain
from stickslip.simulation.explain import explain
from validation.exact import reference

DRY = DryFriction(0.2, 0.1)


def line_of(text, start):
    return next(line for line in text.splitlines() if line.strip().startswith(start))


def test_a_scene_without_springs_has_no_positions():
    text = explain(flywheel_benchmark())
    assert line_of(text, "States:") == "States: 2"
    assert "2 velocities: wheel1, wheel2" in text
    assert "no positions: no spring acts" in text
    assert "stop times and not guards: 0.05, 0.1, 0.15, 0.4, 0.5, 0.6 s" in text
    assert "Matrices: dense (bodies and contacts together: 4" in text


def test_positions_are_where_springs_act():
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Spring("a", GROUND, stiffness=1.0),
        Spring("b", GROUND, stiffness=0.0, damping=1.0),
    )
    text = explain(scene)
    assert line_of(text, "States:") == "States: 3"
    assert line_of(text, "1 position") == "  1 position, where springs act: a"
    assert "Contacts: none" in text


def test_contacts_that_vanish_are_named_with_the_reason():
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("ice", "a", GROUND, DryFriction(0.0, 0.0), normal=3.0),
        Contact("air", "a", GROUND, DRY, normal=-1.0),
        Contact("floor", "a", GROUND, DRY, normal=2.0),
    )
    text = explain(scene)
    assert "Contacts: 1 of 3 assembled" in text
    assert line_of(text, "floor:").endswith("normal force 2 N")
    assert line_of(text, "left out, frictionless") == "  left out, frictionless: ice"
    assert line_of(text, "left out, never loaded") == "  left out, never loaded: air"
    watched = explain(simulate(scene, (0.0, 1.0)))
    assert "1 s in 1 piece: 1 guard; forward floor" in watched


def test_laws_without_sticking_say_what_they_watch():
    def of(law):
        return explain(Scene(Body("a", inertia=1.0), Contact("c", "a", GROUND, law, normal=1.0)))

    assert "guards: 1 slipping (w), 2 stuck (B - r and B + r)" in of(DRY)
    assert "with the dwell's rise" in of(DryFriction(0.2, 0.1, dwell=0.5))
    assert "kinetic curve" in of(DryFriction(0.2, 0.1, stribeck_velocity=0.1))
    assert "no mode and no guard" in of(PreSlip(DRY, shape="tanh"))
    assert "2 in pre-slip" in of(PreSlip(DRY))
    lugre = of(LuGre(DRY, stiffness=1e3))
    assert "1 bristle deflection: c" in lugre and "no mode and no guard" in lugre


def test_curved_loads_are_told_from_straight_ones():
    text = explain(Scene(Body("a", inertia=1.0), Force("a", sine(1.0, 4.0))))
    assert "Loads: no breaks" in text
    assert "1 load entry not piecewise linear, shortest period 0.25 s" in text


def test_a_span_cuts_the_breaks():
    assert "2 breaks, stop times and not guards: 0.05, 0.1 s" in explain(flywheel_benchmark(), (0.0, 0.12))
    with pytest.raises(ValueError, match="swap the two times"):
        explain(flywheel_benchmark(), (1.0, 0.0))


def test_large_scenes_are_sparse_and_shortened():
    text = explain(flywheel_chain(300))
    assert "Matrices: sparse (bodies and contacts together: 600" in text
    assert "... and 288 more" in text and "... (288 more)" in text
    assert len(text.splitlines()) < 30


def test_benchmark_events_have_their_numbers():
    text = explain(simulate(flywheel_benchmark(), (0.0, 4.0)))
    assert line_of(text, "0.473006762576 s") == (
        "  0.473006762576 s  interface STUCK -> BACKWARD: broke away backward: "
        "needed 19.9109 to stay stuck, could hold 19.9109; slips on with 10"
    )
    assert line_of(text, "0.52759333899 s").endswith(
        "its relative velocity reached 0; needs 10 to stay stuck, can hold 21.722"
    )
    assert "Sets of modes met: 5" in text
    assert "No event can have been missed: of the guards looked at, " in text
    assert "3 guards; stuck interface; forward brake" in text
    assert text.count(" -> ") == 5


def test_every_event_of_the_references_gets_a_sentence():
    for name in ("star", "wave", "two-blocks"):
        story = reference(name)
        text = explain(simulate(story.scene, (0.0, story.stop)))
        lines = text[text.index("Events:") :].splitlines()[1:]
        assert len(lines) == len(story.events)
        assert all("hold" in line for line in lines)


def test_a_jump_of_the_load_is_a_cause():
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("floor", "a", GROUND, DRY, normal=10.0),
        Force("a", step(1.0, 0.5, 3.0)),
    )
    text = explain(simulate(scene, (0.0, 2.0)))
    assert "broke away forward by a jump of the loads: needed 0.5 just before, could then hold 2" in text


def test_a_jump_of_a_drive_is_a_cause():
    """The drive runs at -1 m/s for 1 ms, then at 1 m/s again: the block has lost 1 m/s² * 1 ms = 0.001 m/s."""
    drive = Drive("drive", velocity=piecewise_linear([1.0, 1.0, 1.001, 1.001], [1.0, -1.0, -1.0, 1.0]))
    contact = Contact("floor", "a", "drive", DryFriction(0.1, 0.1), normal=10.0)
    result = simulate(Scene(Body("a", inertia=1.0, velocity=1.0), drive, contact), (0.0, 2.0))
    assert [event.cause for event in result.events] == [*2 * ["jump of velocities"], "relative velocity 0"]
    text = explain(result)
    assert "floor STUCK -> FORWARD: its relative velocity jumped from 0 to 2 with a drive" in text
    assert "floor FORWARD -> BACKWARD: its relative velocity jumped from 1.999 to -0.001 with a drive" in text


def test_relaxation_and_reversal_are_told():
    glue = DryFriction(0.1, 0.0)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Damper("a", GROUND, damping=5.0),
        Contact("c", "a", GROUND, glue, normal=1.0),
    )
    assert "relaxed to rest" in explain(simulate(scene, (0.0, 20.0)))
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Force("a", -3.0),
        Contact("c", "a", GROUND, DRY, normal=10.0),
    )
    text = explain(simulate(scene, (0.0, 1.0)))
    assert "c FORWARD -> BACKWARD: passed 0 without sticking: that would have needed more than the 2" in text


def test_other_laws_tell_their_own_story():
    def of(law):
        scene = Scene(Body("a", inertia=1.0, velocity=1.0), Contact("c", "a", GROUND, law, normal=10.0))
        return explain(simulate(scene, (0.0, 3.0)))

    assert "came into the dead band of 0.001" in of(Karnopp(DRY))
    assert "back in pre-slip at |w| = 0.0001" in of(PreSlip(DRY))


def test_without_dense_output_causes_have_no_numbers():
    result = simulate(flywheel_benchmark(), (0.0, 4.0), t_eval=np.linspace(0, 4, 5), dense_output=False)
    text = explain(result)
    assert line_of(text, "0.473006762576 s").endswith("STUCK -> BACKWARD: breakaway")


def test_only_scenes_and_results_are_explained():
    with pytest.raises(TypeError, match="expected a Scene or a Result, got int"):
        explain(3)
    with pytest.raises(ValueError, match="leave t_span out"):
        explain(simulate(flywheel_benchmark(), (0.0, 0.1)), (0.0, 1.0))


def test_feedback_says_what_is_linear_and_what_is_not():
    heat = Block(
        "heat",
        inputs=[power("c")],
        states=[0.0],
        derivative=lambda t, x, u: u,
        output=lambda t, x, u: x,
    )
    scene = Scene(
        Body("m", inertia=1.0),
        Contact("c", "m", GROUND, DRY, normal=1.0 - 0.1 * output("heat")),
        heat,
        pid("pid", 1 - position("m"), kp=1.0, period=0.25),
        StateSpace("lag", [[-1.0]], [[1.0]], [[1.0]], inputs=[output("pid")]),
        Force("m", output("lag") - 2 * velocity("m")),
        Force("m", table(velocity("m"), [0.0, 1.0, 2.0], [1.0, 2.0, 0.0])),
        Force("m", feedback(np.sin, position("m"))),
    )
    text = explain(scene)
    assert "1 position, where springs act or quantities read them: m" in text
    for line in (
        "  normal force of 'c': linear in the state; reads heat",
        "  force on 'm': linear in the state; reads lag",
        "  force on 'm': straight lines, 3 corners",
        "  force on 'm': smooth, by feedback function sin",
        "  block 'heat': smooth functions",
        "  block 'lag': linear",
        "  block 'pid': sampled every 0.25 s, held between",
        "Loads: no breaks",
    ):
        assert line in text.splitlines(), text
    assert "Engine: CVODE BDF, because force on 'm': feedback function sin depends on the state" in text


def test_gears_in_a_loop_that_do_not_fit_are_told():
    """Ratios of 2 and 2 in a row and 3 beside them leave no motion; a fourth body and a driven shaft move."""
    bodies = [Body(name, inertia=1.0) for name in "abcde"]
    gears = (
        Gear("g1", "a", "b", ratio=2.0),
        Gear("g2", "b", "c", ratio=2.0),
        Gear("g4", "d", "shaft", ratio=3.0),
    )
    shaft = Drive("shaft", velocity=0.0)
    text = explain(Scene(*bodies, shaft, *gears, Gear("g3", "a", "c", ratio=3.0), Force("a", 1.0)))
    assert "  locked, because ties leave no motion but rest: a, b, c\n" in text
    assert "locked" not in explain(Scene(*bodies, shaft, *gears, Gear("g3", "a", "c", ratio=4.0)))


def test_a_run_that_an_event_of_the_user_stops_is_not_said_to_reach_its_end():
    fast = When("fast", velocity("car") - 1.0, stop=True)
    result = simulate(Scene(Body("car", inertia=1.0), Force("car", 2.0)), (0.0, 3.0), events=[fast])
    assert result.success and result.status == 1
    told = line_of(result.explain(), "Simulation:")
    assert told.startswith("Simulation: event 'fast' stopped the simulation at t = 0.5 s; states 1")


def test_an_open_contact_is_watched_for_its_direction_only():
    rub = Contact("rub", "block", GROUND, DRY, normal=piecewise_linear([2.0, 3.0], [0.0, 1.0]))
    scene = Scene(Body("block", inertia=1.0, velocity=1.0), rub, Force("block", -1.0))
    assert "where it is 0 the contact is open, and only its direction is watched" in explain(scene)
    (event,) = simulate(scene, (0.0, 1.5)).events
    assert event.cause == "open" and event.t == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("together", [False, True])
def test_what_changes_at_the_same_instant_is_named(together: bool) -> None:
    """A load turns round, and the clutch runs free; where the load at the stop turns round as well, the stop opens."""
    turns = step(1.0, 1.0, -1.0)
    scene = Scene(
        *(Body(name, inertia=1.0) for name in "ab"),
        Body("c", inertia=1.0, position=1.0),
        OneWay("clutch", "a", "b"),
        Stop("stop", "c", GROUND, upper=1.0),
        Damper("b", GROUND, damping=1.0),
        Force("a", turns),
        Force("c", turns if together else 1.0),
    )
    text = explain(simulate(scene, (0.0, 2.0)))
    beside = " with the change of {}" if together else ""
    clutch = f"1 s  clutch STUCK -> BACKWARD: its force came to 0{beside.format('stop')}: runs free backward"
    stop = f"1 s  stop FORWARD -> OPEN: left its upper limit{beside.format('clutch')} at relative velocity 0"
    assert clutch in text
    assert (stop in text) is together


def test_open_contacts_tell_where_their_velocity_points() -> None:
    """A push at 1 s sets one body going; another, thrown with 2 m/s against a load of 1 N, turns back at 2 s."""
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=v) for name, v in (("rests", 0.0), ("thrown", 2.0))),
        *(Contact(name, name, GROUND, DryFriction(0.2, 0.1), normal=0.0) for name in ("rests", "thrown")),
        Force("rests", step(1.0, 0.0, 1.0)),
        Force("thrown", -1.0),
    )
    text = explain(simulate(scene, (0.0, 3.0)))
    assert "1 s  rests STUCK -> FORWARD: carries no force; its relative velocity now points forward" in text
    assert "2 s  thrown FORWARD -> BACKWARD: carries no force; its relative velocity now points backward" in text


def test_an_impact_without_restitution_does_not_rebound() -> None:
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0), Stop("wall", "m", GROUND, upper=0.5), Spring("m", GROUND, stiffness=1.0)
    )
    said = simulate(scene, (0.0, 3.0)).explain()
    assert "struck its upper limit at relative velocity 0.866025, and did not rebound" in said
