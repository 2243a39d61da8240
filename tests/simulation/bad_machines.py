"""Bad ties, gears, clutches, gaps and stops: each refusal names the element, the value and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bad_elements import INF, NAN, Case

from stickslip import (
    GROUND,
    Body,
    Drive,
    Force,
    Gap,
    Gear,
    OneWay,
    Planetary,
    Scene,
    Stop,
    Tie,
    When,
    normal,
    power,
    relative_velocity,
    simulate,
    stretch,
)

A, B = (Body(name, inertia=1.0) for name in "ab")
MOTOR, BELT = Drive("motor", velocity=1.0), Drive("belt", velocity=2.0)
Z = Body("z", inertia=0)
LIMITS = {"lower": -0.1, "upper": 0.1}


def run(*elements: Any, **options: Any) -> Callable[[], Any]:
    return lambda: simulate(Scene(*elements), (0.0, 1.0), **options)


def place(*elements: Any) -> Callable[[], Any]:
    return lambda: Scene(*elements)


def read(table: str, **row: Any) -> Callable[[], Any]:
    return lambda: Scene.from_dict({"bodies": [{"name": "a", "inertia": 1.0}], table: [row]})


def gap(**values: Any) -> Callable[[], Any]:
    return lambda: Gap("play", "a", "b", **values)


def stop(**values: Any) -> Callable[[], Any]:
    return lambda: Stop("end", "a", "b", **values)


MACHINES: list[Case] = [
    # limits
    (gap(stiffness=1, upper=-INF), ValueError, ["gap 'play'", "upper", "-inf", "leave it out"]),
    (stop(lower=INF), ValueError, ["stop 'end'", "lower", "got inf", "leave it out"]),
    (stop(), ValueError, ["stop 'end'", "neither lower nor upper", "give at least one"]),
    (gap(stiffness=1, lower=2, upper=1), ValueError, ["gap 'play'", "got 2 and 1", "exchange them"]),
    (stop(lower=1, upper=1), ValueError, ["stop 'end'", "both 1", "use a Tie"]),
    (gap(stiffness=0, upper=1), ValueError, ["gap 'play'", "stiffness", "got 0", "use a Stop"]),
    (gap(stiffness=None, upper=1), TypeError, ["gap 'play'", "stiffness must be a number", "None"]),
    (stop(upper=1, restitution=1.5), ValueError, ["stop 'end'", "within [0, 1]", "1.5"]),
    (stop(upper=1, restitution="hard"), TypeError, ["stop 'end'", "restitution must be a number", "'hard'"]),
    (stop(upper=1, radius_a=0), ValueError, ["stop 'end'", "radius_a must not be 0", "use 1"]),
    # members
    (
        place(A, MOTOR, Stop("end", "motor", GROUND, upper=1)),
        ValueError,
        ["stop 'end'", "'motor' nor 'ground'", "join at least one Body"],
    ),
    (
        place(A, MOTOR, Gap("play", "motor", GROUND, upper=1, stiffness=1)),
        ValueError,
        ["gap 'play'", "'motor' nor 'ground'", "join at least one Body"],
    ),
    (
        place(A, MOTOR, OneWay("free", "motor", GROUND)),
        ValueError,
        ["one-way clutch 'free'", "'motor' nor 'ground'", "join at least one Body"],
    ),
    (place(A, Stop("end", "a", "x", upper=1)), ValueError, ["stop 'end'", "'x'", "known are 'a'"]),
    (
        place(A, Gap("play", "a", "x", upper=1, stiffness=1)),
        ValueError,
        ["gap 'play'", "'x'", "known are 'a'"],
    ),
    (
        place(A, B, Gear("c", "a", "b", ratio=1), Stop("c", "a", "b", upper=1)),
        ValueError,
        ["stop 'c' stands twice", "rename"],
    ),
    # bodies without inertia
    (
        run(A, Z, Gap("g", "a", "z", stiffness=1, **LIMITS), Gap("h", "z", GROUND, stiffness=1, **LIMITS)),
        ValueError,
        ["body 'z'", "got 0", "ties alone do not decide", "give it an inertia, however small"],
    ),
    (
        run(A, Z, Stop("end", "a", "z", **LIMITS)),
        ValueError,
        ["body 'z'", "got 0", "ties alone do not decide", "give it an inertia, however small"],
    ),
    # ratios
    (lambda: Gear("g", "a", "b", ratio=True), TypeError, ["gear 'g'", "ratio must be a number", "True"]),
    (lambda: Gear("g", "a", "b", ratio=0), ValueError, ["gear 'g'", "ratio must not be 0", "a Tie"]),
    (
        lambda: Planetary("p", sun="a", carrier="b", ring="c", ratio="2"),
        TypeError,
        ["planetary 'p'", "ratio must be a number", "'2'"],
    ),
    (
        lambda: Planetary("p", sun="a", carrier="b", ring="c", ratio=NAN),
        ValueError,
        ["planetary 'p'", "ratio must be finite", "nan"],
    ),
    (lambda: Planetary("p", sun="a", carrier="b", ring=None, ratio=2), TypeError, ["ring", "name", "None"]),
    (lambda: Tie("t", {"a": True, "b": 1.0}), TypeError, ["tie 't'", "coefficient of 'a'", "True"]),
    # velocities and positions at the start
    (
        run(
            Body("a", inertia=1, velocity=2.0),
            Body("b", inertia=1, velocity=1.0),
            Body("c", inertia=1, velocity=1.0),
            Gear("g", "a", "b", ratio=2),
            Gear("h", "b", "c", ratio=1),
            Gear("k", "c", "a", ratio=1),
        ),
        ValueError,
        ["gear 'k'", "break it by -1", "give its bodies velocities"],
    ),
    (
        run(A, MOTOR, Gear("g", "motor", "a", ratio=2)),
        ValueError,
        ["gear 'g'", "break it by 1", "'motor' 1", "give its bodies velocities"],
    ),
    (
        run(A, MOTOR, OneWay("free", "motor", "a")),
        ValueError,
        ["one-way clutch 'free'", "is 1", "'motor' 1", "exchange a and b"],
    ),
    (
        run(A, MOTOR, BELT, Gear("g", "a", "motor", ratio=1), Gear("h", "a", "belt", ratio=1)),
        ValueError,
        ["'motor', 'belt'", "leave a tie out"],
    ),
    (
        run(Body("a", inertia=1, position=1.0), Stop("end", "a", GROUND, upper=1, radius_a=2.0)),
        ValueError,
        ["stop 'end'", "stretch is 2", "upper limit 1", "positions within the limits"],
    ),
    (
        run(A, Stop("left", "a", GROUND, lower=1), Stop("right", "a", GROUND, upper=0)),
        ValueError,
        ["stop 'left'", "stretch is 0", "lower limit 1", "positions within the limits"],
    ),
    # methods
    (
        run(A, Stop("end", "a", GROUND, upper=1), method="RK4", step=0.01),
        ValueError,
        ["stop 'end'", "cannot locate impacts", "use method='series' or 'BDF', or a Gap"],
    ),
    (
        run(A, Stop("end", "a", GROUND, upper=1), method="Euler", step=0.01),
        ValueError,
        ["stop 'end'", "cannot locate impacts", "use method='series' or 'BDF', or a Gap"],
    ),
    # quantities
    (
        place(A, B, Gear("g", "a", "b", ratio=1), Force("a", normal("g"))),
        ValueError,
        ["force on 'a'", "gear 'g' has no normal force", "name a contact"],
    ),
    (
        place(A, Stop("end", "a", GROUND, upper=1), Force("a", power("end"))),
        ValueError,
        ["force on 'a'", "stop 'end' has no power", "name a contact"],
    ),
    (
        place(A, Stop("end", "a", GROUND, upper=1), Force("a", stretch("nope"))),
        ValueError,
        ["force on 'a'", "'nope'", "known are 'end'"],
    ),
    (
        run(A, Stop("end", "a", GROUND, upper=1), events=[When("w", relative_velocity("nope"))]),
        ValueError,
        ["event 'w'", "'nope'", "known are 'end'"],
    ),
    # scene files
    (
        read("stops", name="end", a="a", b=GROUND, upper=1, bounce=0.5),
        ValueError,
        ["stops[0]", "unknown field 'bounce'", "restitution"],
    ),
    (
        read("gaps", name="play", a="a", b=GROUND, upper=1),
        ValueError,
        ["gaps[0]", "field 'stiffness' is missing", "a Gap needs it"],
    ),
    (
        read("ties", name="t", coefficients=[1, 2]),
        TypeError,
        ["ties[0]", "tie 't'", "must be a dict", "[1, 2]"],
    ),
    (
        lambda: Scene.from_dict({"bodies": [{"name": "a", "inertia": 1.0}], "gaps": {"name": "play"}}),
        TypeError,
        ["gaps must be a list of tables", "{'name': 'play'}"],
    ),
]
