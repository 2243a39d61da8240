"""Rows against `validation.analytic`: closed forms in 40 digits that share no line with the package."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import trapezoid

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Result,
    Scene,
    Spring,
    benchmark,
    simulate,
    sine,
)
from validation import analytic
from validation.against_oracles import scene_of
from validation.rows import (
    FORMULATIONS,
    Answer,
    Array,
    Change,
    Row,
    asked,
    changes,
    event_error,
    require,
    worst,
)

TIGHT: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-12}

# Bounds: roundoff where the motion is quadratic between events, a thousand times rtol where it is integrated.
CLOSED, INTEGRATED = 1e-13, 1e-7

FOLDER = Path(__file__).parents[1] / "tests" / "reference"
exact_row = partial(Row, "Closed forms")


@dataclass(frozen=True)
class Story:
    """A scene whose motion is known: events, and velocities of `bodies` at the times `t`, a line per time.

    Positions, too, where they are known.
    """

    title: str
    scene: Scene
    stop: float
    bodies: tuple[str, ...]
    events: list[Change]
    t: Array
    velocities: Array
    positions: Array | None = None

    def seen(self, result: Result) -> Array:
        """Return the velocities of a run as those of the story stand."""
        return np.array([result.velocity(body) for body in self.bodies]).T


def _plain(events: Iterable[analytic.Event]) -> list[Change]:
    return [(float(e.time), e.contact, e.before, e.after) for e in events]


def _grid(stop: float, velocity: Callable[[float], Any], count: int = 201) -> tuple[Array, Array]:
    t = np.linspace(0.0, stop, count)
    rows = [velocity(analytic.mp.mpf(s)) for s in t.tolist()]
    return t, np.array([[float(v) for v in row] for row in rows])


# Stories


@cache
def two_flywheels() -> Story:
    """The benchmark of Breedveld (2000), table 1."""
    motion = analytic.two_flywheels()
    grid = _grid(4.0, motion.velocity, 401)
    return Story(
        "Two flywheels and a brake",
        benchmark.flywheel_benchmark(),
        4.0,
        ("wheel1", "wheel2"),
        _plain(motion.events),
        *grid,
    )


def pulled(static: float = 1.5) -> Scene:
    """Return a block that a spring pulls over the floor; its Coulomb coefficient is 1."""
    return Scene(
        Body("block", inertia=1.0),
        Drive("plate", velocity=0.1),
        Contact("floor", "block", GROUND, DryFriction(static, 1.0), normal=1.0),
        Spring("block", "plate", stiffness=2.0),
    )


@cache
def pulled_block() -> Story:
    """A block on the floor, pulled by a spring whose end moves steadily: stick-slip."""
    motion = analytic.pulled_block(1, 2, 0.1, normal=1, mu_static=1.5, mu_coulomb=1)
    t, v = _grid(40.0, lambda s: motion.state(s)[1:])
    return Story("A block pulled by a spring", pulled(), 40.0, ("block",), _plain(motion.events(40)), t, v)


@cache
def reference(name: str) -> Story:
    """A scene of tests/reference with its answer."""
    data = json.loads((FOLDER / f"{name}.json").read_text())
    answer, stop = data["answer"], float(data["scene"]["t_end"])
    events = [tuple(event) for event in answer["events"]]
    t, v, x = (np.array(answer[key]) for key in "tvx")
    return Story(name, scene_of(data["scene"], None), stop, tuple(answer["names"]), events, t, v, x)


def simulated(story: Story, formulation: str) -> Result:
    """Simulate a story at its times."""
    return simulate(story.scene, (0.0, story.stop), **asked(formulation), t_eval=story.t, **TIGHT)


def told(story: Callable[[], Story], formulation: str) -> Answer:
    """Simulate a story and compare its events and velocities."""
    s = story()
    result = simulated(s, formulation)
    times = event_error(changes(result), s.events, s.stop)
    velocities = worst(s.seen(result), s.velocities)
    return max(times, velocities), f"{len(s.events)} events, times {times:.1e}, velocities {velocities:.1e}"


REFERENCES = {
    "flywheels-2": "two flywheels with a brake",
    "flywheels-4": "four flywheels with a brake",
    "flywheels-4-viscous": "four flywheels with a brake and viscous friction",
    "pulled-block": "a pulled block",
    "pulled-block-dwell": "a pulled block whose friction grows while it rests",
    "star": "three arms on a hub, a brake and a load",
    "two-blocks": "two coupled blocks pulled by one plate",
    "wave": "a block on a spring under a triangular wave",
}
STORIES: dict[str, tuple[Callable[[], Story], str, str]] = {
    "two-flywheels": (
        two_flywheels,
        "two flywheels and a brake",
        "Breedveld 2000, table 1; analytic.two_flywheels",
    ),
    "pulled-block": (
        pulled_block,
        "a block pulled by a spring",
        "Wangen 2010, eqs. (8.12)-(8.14); analytic.pulled_block",
    ),
} | {
    f"reference-{name}": (partial(reference, name), about, "tests/reference, 40-digit arithmetic")
    for name, about in REFERENCES.items()
    if name not in ("flywheels-2", "pulled-block")  # these stand above
}
_FREE_OF_SPRINGS = ("two-flywheels", "reference-flywheels-4", "reference-star")


def _story_rows() -> Iterator[Row]:
    for name, (story, about, source) in STORIES.items():
        for formulation in FORMULATIONS:
            integrated = formulation != "contact-force" or name not in _FREE_OF_SPRINGS
            what = f"{about}: event times over the span, velocities over the largest ({formulation})"
            check = partial(told, story, formulation)
            yield exact_row(f"{name}/{formulation}", what, source, check, INTEGRATED if integrated else CLOSED)


# Two bodies, one contact


def stick_phase(formulation: str) -> Answer:
    """Force and acceleration of two stuck bodies, for loads and inertias over six decades."""
    random = np.random.default_rng(1)
    errors = []
    for _ in range(12):
        m1, m2 = 10.0 ** random.uniform(-3, 3, 2)
        f1, f2 = random.uniform(-5, 5, 2)
        result = simulate(_pair(m1, m2, f1, f2, 100.0), (0.0, 1.0), **asked(formulation), t_eval=[0.0, 0.5, 1.0])
        force, acceleration = analytic.stick_phase(f1, f2, m1, m2)
        require(not result.events, "stuck bodies slip")
        lam, v = result.force("c"), result.velocity("a")
        errors.append(worst(lam, np.full(3, float(force)), abs(f1) + abs(f2)))
        errors.append(worst(v, float(acceleration) * result.t))
        require(bool(np.all(result.relative_velocity("c") == 0)), "stuck bodies drift apart")
    return max(errors)


def _pair(m1: float, m2: float, f1: float, f2: float, normal: float, speed: float = 0.0) -> Scene:
    return Scene(
        Body("a", inertia=m1, velocity=speed),
        Body("b", inertia=m2),
        Contact("c", "a", "b", DryFriction(0.5, 0.4), normal=normal),
        Force("a", f1),
        Force("b", f2),
    )


def stick_limit() -> Answer:
    """Eq. (1) tends to eq. (2), and the ground is its limit: lambda = F, exactly."""
    errors = []
    for power in (3, 6, 9, 12, 15, 100):
        m2 = 10.0**power
        result = simulate(_pair(1.0, m2, 3.0, -2.0, 100.0), (0.0, 1.0), t_eval=[1.0])
        exact = analytic.stick_phase(3, -2, 1, analytic.mp.mpf(m2))
        errors.append(worst(result.force("c"), [float(exact.force)]))
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, DryFriction(0.5, 0.4), normal=100.0),
        Force("a", 3.0),
    )
    limit = analytic.stick_phase(3, 0, 1, analytic.mp.inf)
    result = simulate(scene, (0.0, 1.0), t_eval=[1.0])
    errors.append(worst(result.force("c"), [float(limit.force)]) + abs(float(result.velocity("a")[0])))
    return max(errors)


def lock_up(formulation: str) -> Answer:
    """Time and heat of locking, for inertias over six decades."""
    errors = []
    for m1, m2, w0 in ((1.0, 10.0, -0.01), (2.0, 3.0, 4.0), (1e-3, 1e3, 1.0), (1e3, 1e-3, -1.0)):
        exact = analytic.lock_up(m1, m2, w0, 4)
        stop = 2 * float(exact.time)
        options = TIGHT | {"atol": 1e-14} if formulation == "multiplier" else {}
        result = simulate(_pair(m1, m2, 0.0, 0.0, 10.0, w0), (0.0, stop), **asked(formulation), **options)
        mode = 1 if w0 > 0 else -1
        errors.append(event_error(changes(result), [(exact.time, "c", mode, 0)], stop))
        # r is constant and w straight: the trapezoidal rule between computed points is exact
        heat = trapezoid(result.force("c") * (result.velocity("a") - result.velocity("b")), result.t)
        errors.append(worst(heat, float(exact.heat)))
    return max(errors)


def relaxation(formulation: str) -> Answer:
    """Viscous friction alone: w falls exponentially; with mu_c = 0 the contact is found to have come to rest."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=2.0),
        Damper("a", "b", damping=3.0),
        Contact("c", "a", "b", DryFriction(0.5, 0.0), normal=10.0),
    )
    t = np.linspace(0.0, 3.0, 61)
    margin = 1e-5
    result = simulate(scene, (0.0, 6.0), **asked(formulation), velocity_margin=margin, **TIGHT)
    w = simulate(scene, (0.0, 3.0), **asked(formulation), velocity_margin=0.0, t_eval=t, **TIGHT)
    decay = [float(analytic.viscous_relaxation(1, 2, 1, 3, s)) for s in t.tolist()]
    error = worst(w.relative_velocity("c"), decay)
    require([e[1:] for e in changes(result)] == [("c", 1, 0)], f"events {changes(result)}, not one to STUCK")
    found = float(analytic.viscous_relaxation(1, 2, 1, 3, result.events[0].t))
    require(found <= margin * (1 + 1e-2), f"stuck at w = {found:.3g}, outside the margin of {margin:g}")
    # however wide the margin, momentum is kept: both end at a third
    return max(error, worst(result.velocity("a")[-1], 1 / 3)), f"stuck at w = {found:.1e}, margin {margin:g}"


def turning_points(formulation: str) -> Answer:
    """A mass on a spring with dry friction: turns, and where it stays."""
    errors = []
    for x0, friction, breakaway in ((1.0, 0.07, 0.07), (-2.35, 0.3, 0.45)):
        motion = analytic.coulomb_decay(1, 4, friction, x0, breakaway)
        scene = Scene(
            Body("m", inertia=1.0, position=x0),
            Contact("floor", "m", GROUND, DryFriction(breakaway, friction), normal=1.0),
            Spring("m", GROUND, stiffness=4.0),
        )
        stop = float(motion.turns[-1][0]) * 1.2
        t, v = _grid(stop, motion.state)
        result = simulate(scene, (0.0, stop), **asked(formulation), t_eval=t, **TIGHT)
        errors.append(worst(result.position("m"), v[:, 0]))
        errors.append(worst(result.velocity("m"), v[:, 1]))
        turns = [(t, "floor") for t, _ in motion.turns[1:]]
        found = [e for e in changes(result) if e[2] != 0]
        require(len(found) == len(turns), f"{len(found)} turns instead of {len(turns)}")
        errors += [abs(e[0] - float(t[0])) / stop for e, t in zip(found, turns, strict=True)]
        require(result.mode("floor")[-1] == 0 and result.velocity("m")[-1] == 0, "the mass never comes to rest")
    return max(errors), f"{len(errors) - 4} turns"


def den_hartog(beta: float, r: float, formulation: str) -> Answer:
    """Ten periods of steady forced motion."""
    motion = analytic.den_hartog(beta, r)
    stop = 20 * np.pi / beta
    scene = Scene(
        Body("m", inertia=1.0, position=float(motion.amplitude)),
        Contact("floor", "m", GROUND, DryFriction(r, r), normal=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Force("m", sine(1.0, beta / (2 * np.pi), phase=float(motion.phase) + np.pi / 2)),
    )
    t, state = _grid(stop, motion.state)
    result = simulate(scene, (0.0, stop), **asked(formulation), t_eval=t, **TIGHT)
    x, v = worst(result.position("m"), state[:, 0]), worst(result.velocity("m"), state[:, 1])
    return max(x, v), f"amplitude {float(motion.amplitude):.9g}, {len(result.events)} changes of mode"


def _short_rows() -> Iterator[Row]:
    for f in FORMULATIONS:
        loose = f == "multiplier"
        yield exact_row(
            f"stick-phase/{f}",
            f"force and acceleration of two stuck bodies, inertias 1e-3 to 1e3 ({f})",
            "Breedveld 2000, eqs. (1), (7); analytic.stick_phase",
            partial(stick_phase, f),
            CLOSED,
        )
        yield exact_row(
            f"lock-up/{f}",
            f"time until two bodies lock, and the heat made, inertia ratios to 1e6 ({f})",
            "momentum and energy of the relative motion; analytic.lock_up",
            partial(lock_up, f),
            INTEGRATED if loose else CLOSED,
        )
        yield exact_row(
            f"relaxation/{f}",
            f"viscous relaxation: relative velocity, then rest although it never crosses 0 ({f})",
            "w0 exp(-c t (1/m1 + 1/m2)); analytic.viscous_relaxation",
            partial(relaxation, f),
            INTEGRATED,
        )
        yield exact_row(
            f"coulomb-decay/{f}",
            f"position, velocity and turning times of a decaying oscillation; where it stays ({f})",
            "half cosines; Euphonics 8.2.3; analytic.coulomb_decay",
            partial(turning_points, f),
            INTEGRATED,
        )
    yield exact_row(
        "stick-limit",
        "force between stuck bodies as the inertia of one grows to 1e100, and against the ground",
        "Breedveld 2000, eq. (2); analytic.stick_phase",
        stick_limit,
        1e-15,
    )
    for beta, r in ((0.8, 0.5), (2.0, 0.15), (1.25, 0.4)):
        for f in FORMULATIONS:
            yield exact_row(
                f"den-hartog-{beta:g}/{f}",
                f"ten periods of steady forced motion, frequency ratio {beta:g}, friction {r:g} P ({f})",
                "Den Hartog 1930; analytic.den_hartog",
                partial(den_hartog, beta, r, f),
                INTEGRATED,
            )


ROWS = [*_story_rows(), *_short_rows()]
