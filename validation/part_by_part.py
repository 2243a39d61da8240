"""Scenes followed part by part against the same scenes followed as a whole."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import pairwise
from typing import Any
from unittest import mock

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    Result,
    Scene,
    Signal,
    Spring,
    Stop,
    When,
    feedback,
    piecewise_linear,
    position,
    relative_velocity,
    simulate,
    sine,
    velocity,
)
from stickslip.equations import forest
from stickslip.equations.forest import Forest
from stickslip.equations.system import System
from stickslip.simulation import simulate as simulation
from validation.against_oracles import scene_of
from validation.machine_scenes import FAMILIES as MACHINES
from validation.rows import Row, Tried, require, worst
from validation.tried import try_each

STOP = 4.0

# Part of the span by which times of events may differ: gaps may close or open at velocities of 1e-5 of the largest.
EVENTS = 1e-10

PATIENCE = 60.0

OTHERS = [GROUND, "belt"]  # what bodies of these scenes may rub on


# How scenes are followed, and compared


@contextmanager
def part_by_part(knots: bool = False) -> Iterator[None]:
    """Follow all scenes part by part that can be, however few their bodies; `knots` also where most are in knots."""
    in_knots = mock.patch.object(forest, "_MOST_IN_ONE_KNOT", 1.0) if knots else nullcontext()
    with mock.patch.object(simulation, "_MANY", 1), in_knots:
        yield


def as_a_whole() -> Any:
    """Follow no scene part by part."""
    return mock.patch.object(simulation, "_MANY", 10**9)


def both(scene: Scene, stop: float, knots: bool = False, **options: Any) -> tuple[Result, Result]:
    """Return a scene followed part by part, and as a whole."""
    times = np.linspace(0.0, stop, 101)
    with part_by_part(knots):
        local = simulate(scene, (0.0, stop), t_eval=times, **options)
    with as_a_whole():
        return local, simulate(scene, (0.0, stop), t_eval=times, **options)


def difference(scene: Scene, stop: float = STOP, knots: bool = False, events: Sequence[When] = ()) -> float:
    """Return how far a scene followed part by part is from the same as a whole, over the error allowed for roundoff."""
    local, whole = both(scene, stop, knots, events=events)
    return difference_of(local, whole)


def difference_of(local: Result, whole: Result) -> float:
    """Return the largest difference of two results, over the error allowed for roundoff; other events are wrong."""
    stop, scale = float(whole.trajectory.stops[-1]), np.abs(whole.y).max()
    for what in ("fewest_states", "guards"):
        require(local.stats[what] == whole.stats[what], f"the stats tell of other {what}")
    heat = whole.energy().heat
    differences = [
        worst(local.y, whole.y, scale) / 1e-10,
        worst(local.energy().heat, heat, heat.max() + scale**2) / 1e-10,
    ]
    for name in (row.name for row in whole.scene.rows):
        # row by row: the events of two rows in the same instant may be in either order
        here, there = ([e for e in result.events if e.contact == name] for result in (local, whole))
        story, other = ([(e.before, e.after, e.cause) for e in events] for events in (here, there))
        require(story == other, f"events of {name}: {story} part by part, {other} as a whole")
        require(bool((local.mode(name) == whole.mode(name)).all()), f"other modes of {name}")
        differences.append(worst([e.t for e in here], [e.t for e in there], stop) / EVENTS)
        differences.append(worst(local.force(name), whole.force(name)) / 1e-9)
        # levels that rise with the time at rest are as exact as the times of events; many are infinite
        alike = np.allclose(local.breakaway(name), whole.breakaway(name), rtol=1e-9, atol=0.0)
        require(bool(alike), f"other levels of {name}")
    names = {row.name for row in whole.scene.rows}
    of_user = [
        sorted((e.contact, e.before, e.after, e.cause, e.t) for e in result.events if e.contact not in names)
        for result in (local, whole)
    ]
    mine, others = ([event[:-1] for event in events] for events in of_user)
    require(mine == others, f"events of the user: {mine} part by part, {others} as a whole")
    t, t_whole = ([event[-1] for event in events] for events in of_user)
    differences.append(worst(t, t_whole, stop) / EVENTS)
    return max(differences)


def apart(scene: Scene) -> bool:
    """Tell whether a scene can be followed part by part."""
    system = System(scene)
    return Forest.why_not(system, system.loads(0.0, STOP)) is None


# Scenes


def random_forest(seed: int) -> Scene:
    """Return bodies joined by contacts in trees, some of them to the ground or a drive, and by springs anyhow."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 12))
    law = [
        DryFriction(float(s), float(c), dwell=float(rng.choice([0.0, 0.0, 0.05, 0.4])))
        for s, c in zip(rng.uniform(0.3, 0.5, 3), rng.uniform(0.1, 0.3, 3), strict=True)
    ]
    # one rubs more in one direction than in the other
    law[1] = replace(law[1], mu_static_backward=1.3 * law[1].mu_static, mu_coulomb_backward=0.6 * law[1].mu_coulomb)
    elements: list[Any] = [Drive("belt", velocity=float(rng.uniform(-0.5, 0.5)))]
    names = [f"b{i}" for i in range(n)]
    for name in names:
        x, v = rng.normal(size=2)
        elements.append(Body(name, inertia=float(rng.uniform(0.5, 3.0)), velocity=float(v), position=float(x)))
    roots = 0
    for i, name in enumerate(names):
        other = names[int(rng.integers(0, i))] if i and rng.random() < 0.5 else None
        if other is None:
            if rng.random() < 0.2:
                continue
            other, roots = (GROUND if rng.random() < 0.6 else "belt"), roots + 1
        ends = (name, other) if rng.random() < 0.5 else (other, name)
        elements.append(Contact(f"c{i}", *ends, law[i % 3], normal=float(rng.uniform(1.0, 6.0))))
    if rng.random() < 0.8:
        for k, (a, b) in enumerate(pairwise(names)):
            if rng.random() < 0.8:
                elements.append(Spring(a, b, stiffness=float(rng.uniform(1, 8)), damping=float(rng.choice([0, 0.2]))))
            elif rng.random() < 0.5:
                elements.append(Damper(a, b, damping=float(rng.uniform(0.1, 1.0))))
            if k % 3 == 0:
                elements.append(Spring(a, GROUND, stiffness=float(rng.uniform(1, 4))))
    push = piecewise_linear([0.0, 1.0, 2.5, 4.0], [0.0, *rng.normal(scale=4.0, size=3)])
    elements.append(Force(names[0], push))
    return Scene(*elements)


def shaken(scene: Scene, seed: int) -> Scene:
    """Return a scene with slow and fast sines among its forces, in the velocity of its belt, and in normal forces."""
    rng = np.random.default_rng(seed)

    def some(size: float, offset: float = 0.0) -> Signal:
        frequency, phase = float(rng.choice([0.1, 1.0, 9.0])), float(rng.uniform(0.0, 6.0))
        return sine(size, frequency, phase=phase, offset=offset)

    elements: list[Any] = []
    for one in scene.elements:
        if isinstance(one, Drive) and rng.random() < 0.7:
            elements.append(replace(one, velocity=some(float(rng.uniform(0.1, 0.6)), 0.2)))
        elif isinstance(one, Contact) and rng.random() < 0.4:
            assert isinstance(one.normal, Signal)
            level = one.normal.at(0.0)
            elements.append(replace(one, normal=some(float(rng.uniform(0.1, 0.9)) * level, level)))
        else:
            elements.append(one)
    for body in scene.bodies:
        if rng.random() < 0.4:
            elements.append(Force(body.name, some(float(rng.normal(scale=3.0)))))
        if rng.random() < 0.2:
            elements.append(Spring(body.name, "belt", stiffness=float(rng.uniform(1.0, 6.0)), damping=0.1))
    return Scene(*elements)


def with_gaps(scene: Scene, seed: int) -> Scene:
    """Return a scene with gaps between its bodies, to ground and belt: near, far and pressed at the start."""
    rng = np.random.default_rng(seed + 1000)
    names, x = [body.name for body in scene.bodies], {body.name: body.position for body in scene.bodies}
    gaps = []
    for k in range(int(rng.integers(1, len(names) + 2))):
        ends = [str(rng.choice(names)), str(rng.choice([*names, *names, *names, GROUND, "belt"]))]
        rng.shuffle(ends)
        if ends[0] == ends[1]:
            continue
        radii = (1.0, 1.0) if rng.random() < 0.7 else tuple(rng.uniform([0.5, -2.0], [2.0, -0.5]).tolist())
        stretch = radii[0] * x.get(ends[0], 0.0) - radii[1] * x.get(ends[1], 0.0)
        limits = [stretch + float(rng.uniform(-0.5, 0.15)), stretch + float(rng.uniform(0.15, 0.5))]
        if rng.random() < 0.4:
            open_end = int(rng.integers(2))
            limits[open_end] = (-math.inf, math.inf)[open_end]
        gaps.append(
            Gap(
                f"g{k}",
                *ends,
                lower=limits[0],
                upper=limits[1],
                stiffness=float(rng.uniform(2.0, 60.0)),
                damping=float(rng.choice([0.0, 0.3, 2.0])),
                radius_a=radii[0],
                radius_b=radii[1],
            )
        )
    return Scene(*scene.elements, *gaps)


def with_schedules(scene: Scene, seed: int) -> Scene:
    """Return a scene in which bodies are loaded and contacts pressed from time to time, each by a schedule of its own.

    Loads and normal forces kink and jump; many normal forces begin or end with 0. Belts kink, some of them jump.
    """
    rng, of_belts = np.random.default_rng(seed + 4000), np.random.default_rng(seed + 6000)

    def schedule(levels: Sequence[float]) -> Signal:
        times = np.sort(rng.uniform(0.1, STOP - 0.1, int(rng.integers(2, 5))))
        if rng.random() < 0.4:
            # jumps
            times = np.repeat(times, 2)
        return piecewise_linear(times, rng.choice(levels, times.size))

    elements: list[Any] = []
    for one in scene.elements:
        if isinstance(one, Contact) and rng.random() < 0.7:
            assert isinstance(one.normal, Signal)
            level = one.normal.at(0.0)
            elements.append(replace(one, normal=schedule([0.0, level, 2.0 * level])))
        elif isinstance(one, Drive) and of_belts.random() < 0.6:
            times = np.repeat(np.sort(of_belts.uniform(0.1, STOP - 0.1, 4)), 2 if of_belts.random() < 0.2 else 1)
            elements.append(
                replace(one, velocity=piecewise_linear(times, of_belts.choice([-0.5, 0.0, 0.4], times.size)))
            )
        else:
            elements.append(one)
    elements += [Force(body.name, schedule([0.0, 3.0, -3.0, 1.0])) for body in scene.bodies if rng.random() < 0.6]
    elements += [Spring(body.name, "belt", stiffness=2.0) for body in scene.bodies if of_belts.random() < 0.2]
    return Scene(*elements)


def with_breaks_at_events(scene: Scene, seed: int) -> Scene:
    """Return a scene in which loads jump in the instant of events of the scene without them, or as near as can be."""
    rng = np.random.default_rng(seed + 9000)
    with as_a_whole():
        events = [e for e in simulate(scene, (0.0, STOP)).events if 0.05 < e.t < STOP - 0.05]
    bodies, contacts = {body.name for body in scene.bodies}, {one.name: one for one in scene.contacts}
    forces = []
    for k in rng.choice(len(events), min(3, len(events)), replace=False).tolist() if events else []:
        one, t = contacts[events[k].contact], events[k].t * (1.0 + float(rng.choice([0.0, 0.0, 0.0, 1e-15, -1e-15])))
        body = one.a if one.a in bodies else one.b
        forces.append(Force(body, piecewise_linear([t, t], [0.0, float(rng.choice([-2.0, 0.5, 2.0]))])))
    return Scene(*scene.elements, *forces)


def even_chain(seed: int) -> Scene:
    """Return equal bodies in a row with gaps between them: many touch at the start, and much happens at once."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 14))
    lower, stiffness = float(rng.choice([0.9, 1.0])), float(rng.choice([1.0, 4.0, 50.0]))
    damping, speed = float(rng.choice([0.0, 0.5])), float(rng.choice([0.0, 0.5, 1.0]))
    law = DryFriction(float(rng.choice([0.1, 0.15])), 0.1)
    names = [f"b{i}" for i in range(n)]
    elements: list[Any] = [
        Body(name, inertia=1.0, position=-1.0 * i, velocity=speed if i == 0 or rng.random() < 0.3 else 0.0)
        for i, name in enumerate(names)
    ]
    for i, name in enumerate(names):
        if rng.random() < 0.85:
            other = names[i - 1] if i and rng.random() < 0.2 else GROUND
            elements.append(Contact(f"c{i}", name, other, law, normal=float(rng.choice([1.0, 2.0]))))
    for i, (a, b) in enumerate(pairwise(names)):
        # some have no play at all
        upper = 1.0 if lower == 1.0 and rng.random() < 0.2 else 1.1
        elements.append(Gap(f"g{i}", a, b, lower=lower, upper=upper, stiffness=stiffness, damping=damping))
    elements.append(Gap("end", "b0", GROUND, upper=0.3, stiffness=stiffness))
    elements.append(Force("b0", piecewise_linear([0.0, 1.0, 3.0, 4.0], [float(rng.choice([0, 1])), 3.0, -3.0, 0.0])))
    return Scene(*elements)


def with_followers(scene: Scene, seed: int) -> Scene:
    """Return a scene with forces that follow other bodies, which do not feel them."""
    rng = np.random.default_rng(seed + 3000)
    names = [body.name for body in scene.bodies]
    forces = []
    for name in names:
        if rng.random() < 0.5:
            quantity = velocity if rng.random() < 0.5 else position
            forces.append(Force(name, float(rng.uniform(-0.8, 0.8)) * quantity(str(rng.choice(names)))))
    return Scene(*scene.elements, *forces)


def with_machines(scene: Scene, seed: int) -> Scene:
    """Return a scene with machines beside its bodies: ties, levers, stops, clutches and loops, each on springs."""
    rng = np.random.default_rng(seed + 2000)
    elements, names = list(scene.elements), [body.name for body in scene.bodies]
    for k in range(int(rng.integers(1, 4))):
        family = str(rng.choice(["radii", "ties", "clutches", "gaps", "stops", "machines"]))
        own = machine(family, int(rng.integers(1000)), f"k{k} ")
        elements += own
        bodies = [one.name for one in own if isinstance(one, Body) and one.inertia]
        for _ in range(int(rng.integers(1, 4))):
            ends = str(rng.choice(bodies)), str(rng.choice(names))
            elements.append(
                Spring(*ends, stiffness=float(rng.uniform(0.5, 6.0)), damping=float(rng.choice([0.0, 0.2])))
            )
    if rng.random() < 0.3:
        slick = DryFriction(0.0, 0.0)
        elements.append(Contact("slick", str(rng.choice(names)), "belt", slick, normal=2.0))
    return Scene(*elements)


def with_brakes(scene: Scene, seed: int) -> Scene:
    """Return a scene in which many bodies have more contacts, some beside another one, and stops that few touch.

    Some are pressed from time to time only, or by a sine.
    """
    rng = np.random.default_rng(seed + 5000)
    elements: list[Any] = list(scene.elements)
    bodies = {body.name: body for body in scene.bodies}
    ends = [(one.a, one.b) for one in scene.contacts]
    for k, name in enumerate(bodies):
        if rng.random() < 0.5:
            continue
        own = [pair for pair in ends if name in pair]
        a, b = own[int(rng.integers(len(own)))] if own and rng.random() < 0.5 else (name, str(rng.choice(OTHERS)))
        static, coulomb = rng.uniform([0.25, 0.1], [0.5, 0.25]).tolist()
        kind, level = rng.random(), float(rng.uniform(0.5, 5.0))
        t = np.sort(rng.uniform(0.0, STOP, 4))
        normal: Any = level
        if kind < 0.3:
            normal = piecewise_linear(t, [0.0, level, 2.0 * level, 0.0])
        elif kind < 0.4:
            normal = sine(0.5 * level, 1.0, offset=level)
        elements.append(Contact(f"brake {k}", a, b, DryFriction(static, coulomb), normal=normal))
        if rng.random() < 0.3:
            limit = bodies[name].position + float(rng.choice([0.5, 2.0, 9.0]))
            elements.append(Stop(f"stop {k}", name, GROUND, upper=limit))
    return Scene(*elements)


def watched(scene: Scene, seed: int) -> list[When]:
    """Return events of the user for a scene: velocities, positions, differences and products; few stop the run."""
    rng = np.random.default_rng(seed + 77)
    names, rows = [body.name for body in scene.bodies], [row.name for row in scene.rows]

    def quantity() -> Any:
        a, b = (str(name) for name in rng.choice(names, 2))
        level = float(0.3 * rng.normal())
        return [
            velocity(a) - level,
            position(b) - level,
            velocity(a) - (velocity(b) if a != b else 0.0) - level,
            relative_velocity(str(rng.choice(rows))) if rows else velocity(b),
            feedback(lambda v, x: v * x - 0.01, velocity(a), position(b)),
            velocity(a) - sine(0.3, 2.0),
        ][int(rng.integers(6))]

    return [
        When(f"event {k}", quantity(), direction=int(rng.integers(-1, 2)), stop=bool(rng.random() < 0.15))
        for k in range(int(rng.integers(1, 5)))
    ]


def machine(family: str, number: int, prefix: str) -> list[Any]:
    """Return the elements of a machine, with a prefix before all names but that of the ground."""
    return [_named(one, prefix) for one in scene_of(MACHINES[family][0](number), order=None).elements]


def _named(element: Any, prefix: str) -> Any:
    def new(name: str) -> str:
        return prefix + name if name and name != GROUND else name

    own: dict[str, Any] = {one.name: getattr(element, one.name) for one in fields(element)}
    changed: dict[str, Any] = {
        key: new(own[key]) for key in ("name", "a", "b", "body") if isinstance(own.get(key), str)
    }
    if "coefficients" in own:
        changed["coefficients"] = {new(name): c for name, c in own["coefficients"].items()}
    return replace(element, **changed)


# Families: each draws a scene by its number


def shaken_trees(number: int) -> Scene:
    """Return trees with sines."""
    return shaken(random_forest(number), number)


def trees_with_gaps(number: int) -> Scene:
    """Return trees with gaps, every second one with sines."""
    return with_gaps(shaken_trees(number) if number % 2 else random_forest(number), number)


def trees_with_followers(number: int) -> Scene:
    """Return trees with forces that follow bodies, every second one with contacts beside others."""
    scene = random_forest(number)
    return with_followers(with_brakes(scene, number) if number % 2 else scene, number)


def trees_with_machines(number: int) -> Scene:
    """Return trees beside machines, some with sines or gaps."""
    scene = shaken_trees(number) if number % 3 == 0 else random_forest(number)
    return with_machines(with_gaps(scene, number) if number % 4 == 0 else scene, number)


def trees_with_brakes(number: int) -> Scene:
    """Return trees with more contacts than trees have, and with stops; some with gaps or schedules."""
    scene = trees_with_gaps(number) if number % 3 == 0 else random_forest(number)
    return with_brakes(with_schedules(scene, number) if number % 4 == 0 else scene, number)


def trees_with_schedules(number: int) -> Scene:
    """Return trees, some with gaps or sines, whose loads come and go."""
    return with_schedules(trees_with_gaps(number) if number % 3 == 0 else random_forest(number), number)


def trees_with_breaks_at_events(number: int) -> Scene:
    """Return trees, every second one with schedules, with breaks at their events."""
    scene = random_forest(number)
    return with_breaks_at_events(scene if number % 2 else with_schedules(scene, number), number)


@dataclass(frozen=True)
class Family:
    """How scenes are drawn, and with which options of `difference` and events of the user they are compared.

    `left_out` are numbers of scenes that roundoff decides, whichever way they are followed, or that end in an error.
    """

    what: str
    scene: Callable[[int], Scene]
    options: dict[str, Any] = field(default_factory=dict)
    left_out: tuple[int, ...] = ()
    events: Callable[[Scene, int], list[When]] = lambda scene, number: []

    def difference(self, scene: Scene, number: int) -> float:
        """Return how far a scene with a number of its own is from the same as a whole."""
        return difference(scene, **self.options, events=self.events(scene, number))


JAMMED = (50, 103, 137, 304, 384)  # drives press stops and a clutch together: no motion is possible

# The velocity at a stop or a clutch comes to 0 within roundoff: both answers are right, that it touches or does not.
HARDLY_TOUCHES = (16, 87, 132)

# Impacts that accumulate: each amplifies the roundoff of the one before, so that later ones differ.
BOUNCES = (212, 253)

# Two gaps close within a part in a billion of their play: they may close in one instant, or in two.
ALMOST_TOGETHER = (244,)

FAMILIES = {
    "trees": Family("bodies joined by contacts in trees, and by springs anyhow", random_forest),
    "shaken": Family("trees with sines among forces, drives and normal forces", shaken_trees),
    "gaps": Family("trees with gaps between their bodies", trees_with_gaps),
    "chains": Family(
        "equal bodies in a row with gaps, where much happens at once",
        even_chain,
        {"stop": 3.97},
        ALMOST_TOGETHER,
    ),
    "schedules": Family("trees whose loads and normal forces come and go", trees_with_schedules),
    "brakes": Family("trees with contacts beside others, and with stops", trees_with_brakes, {"knots": True}),
    "instants": Family("trees whose loads jump in the instants of events", trees_with_breaks_at_events),
    "followers": Family("trees with forces that follow other bodies", trees_with_followers, {"knots": True}),
    "machines": Family(
        "trees beside machines: ties, levers, stops, clutches, loops",
        trees_with_machines,
        {"knots": True},
        JAMMED + HARDLY_TOUCHES + BOUNCES,
    ),
    "watched": Family("trees with gaps and events of the user", trees_with_gaps, events=watched),
}


def draw(family: str, number: int) -> Scene | None:
    """Return a scene of a family, or None for one that can only be followed as a whole, or that is left out."""
    drawn = FAMILIES[family]
    if number in drawn.left_out:
        return None
    scene = drawn.scene(number)
    with part_by_part(drawn.options.get("knots", False)):
        return scene if apart(scene) else None


def _differences(family: str, count: int) -> Tried:
    scenes = ((number, draw(family, number)) for number in range(count))
    return try_each(
        (
            (f"{family} {number}", partial(FAMILIES[family].difference, scene, number))
            for number, scene in scenes
            if scene is not None
        ),
        limit=PATIENCE,
    )


def rows(scenes: int) -> list[Row]:
    """Return the rows over `scenes` scenes of each family."""
    return [
        Row(
            "Engines against each other",
            f"parts-{family}",
            f"{scenes} random scenes, part by part against as a whole ({drawn.what}): states, events, forces, heat "
            "over what roundoff may leave",
            "the same motion",
            partial(_differences, family, scenes),
            1.0,
            limit=60.0 + 10.0 * scenes,
            tries="scenes followed part by part",
        )
        for family, drawn in FAMILIES.items()
    ]
