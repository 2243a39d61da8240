"""Edge scenes: loads that come to a level, jump through it or only touch it, worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Scene,
    Signal,
    Spring,
    piecewise_linear,
    simulate,
    sine,
)
from validation.rows import Change, Row, Tried, changes, event_error, require, worst
from validation.tried import try_each

METHODS = [
    ("contact-force", "auto", 1e-15),
    ("contact-force", "BDF", 1e-9),
    ("contact-force", "Adams", 1e-12),
]
METHODS += [("merged", "BDF", 1e-9), ("merged", "Adams", 1e-12), ("multiplier", "BDF", 1e-12)]
"""Formulations, methods, and the largest errors that pass: roundoff for the default method."""
OPTIONS: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-12}
PATIENCE = 20.0
DRY = DryFriction(0.3, 0.2)
EQUAL = DryFriction(0.2, 0.2)
NONE = DryFriction(0.0, 0.0)
SLOW = DryFriction(0.3, 0.2, dwell=0.5)
ODD = DryFriction(0.3, 0.2, mu_static_backward=0.5, mu_coulomb_backward=0.4)
HALF = 0.5 * math.log(2.0)  # time in s after which SLOW has half of its rise left

# A sequence of points (time, value) is straight lines between them.
Load = Signal | float | Sequence[tuple[float, float]]
Modes = tuple[float, int, int]  # time in s, mode before, mode after


@dataclass(frozen=True)
class Edge:
    """A scene, its events up to `stop`, and velocities of bodies at times."""

    name: str
    scene: Scene
    stop: float
    events: Sequence[Change]
    speeds: dict[str, dict[float, float]]


def _edge(
    name: str,
    *elements: Any,
    events: Sequence[Modes] = (),
    of: Sequence[str] = ("c",),
    end: float = 0.0,
    way: dict[float, float] | None = None,
    stop: float = 2.0,
) -> Edge:
    """Return a scene whose contacts `of` have the same events; body b has a velocity at the end, and on the way."""
    happens = [(t, contact, before, after) for t, before, after in events for contact in of]
    return Edge(name, Scene(*elements), stop, happens, {"b": (way or {}) | {stop: end}})


def _lines(load: Load) -> Signal | float:
    return piecewise_linear(*zip(*load, strict=True)) if isinstance(load, Sequence) else load


def _floor(law: DryFriction = DRY, normal: Load = 10.0, name: str = "c", **more: Any) -> Contact:
    return Contact(name, "b", GROUND, law, normal=_lines(normal), **more)


def _body(velocity: float = 0.0) -> Body:
    return Body("b", inertia=1.0, velocity=velocity)


def _push(load: Load) -> Force:
    return Force("b", _lines(load))


def _on_floor(
    name: str,
    load: Load = 0.0,
    law: DryFriction = DRY,
    normal: Load = 10.0,
    velocity: float = 0.0,
    rested: float = 0.0,
    **told: Any,
) -> Edge:
    """Return a block of 1 kg on the floor."""
    return _edge(name, _body(velocity), _floor(law, normal, rested=rested), _push(load), **told)


def _levels() -> list[Edge]:
    """The block breaks loose at 3 N and slides at 2 N."""
    loose, tiny = [(1.0, 0, 1)], 1e-9
    # a triangle that passes the level by so little: v = s - 1.5 s^2 from its peak on, but for what it has gained before
    peak = 3 * (1 + tiny)
    broken = 1 / (1 + tiny)
    gained = (1 - broken) * ((peak * (1 + broken)) / 2 - 2)
    stopped = 1 + (peak - 2 + math.sqrt((peak - 2) ** 2 + 2 * peak * gained)) / peak
    return [
        _on_floor("load at the level", 3.0),
        _on_floor("load at the lower level", -3.0),
        _on_floor("load above it", 3 * (1 + tiny), end=2 * (1 + 3 * tiny)),
        _on_floor("load that falls from it", [(0, 3), (2, 0)]),
        _on_floor("load that rises from it", [(0, 3), (2, 9)], end=8.0),
        _on_floor("ramp to the level", [(0, 0), (1, 3)]),
        _on_floor("ramp that touches it", [(0, 0), (1, 3), (2, 0)]),
        _on_floor("ramp that stays below it", [(0, 0), (1, 3 * (1 - tiny)), (2, 0)]),
        _on_floor(
            "ramp that passes it by a billionth",
            [(0, 0), (1, peak), (2, 0)],
            events=[(broken, 0, 1), (stopped, 1, 0)],
        ),
        _on_floor("ramp through it at a break", [(0, 0), (1, 3), (2, 5)], events=loose, end=2.0),
        _on_floor("sine that touches it", sine(3.0, 0.25), stop=20.0),
        _on_floor(
            "nearly at rest where the load jumps",
            [(0, 0), (0.5, 0), (0.5, -1), (2, -1)],
            velocity=1 + 1e-7,
            events=[(0.5 + 1e-7 / 3, 1, 0)],
        ),
        _edge(
            "spring at the level",
            Body("b", inertia=1.0, position=0.3),
            _floor(),
            Spring("b", GROUND, stiffness=10.0),
            stop=100.0,
        ),
        _on_floor("equal levels, ramp", [(0, 0), (1, 2), (2, 4)], EQUAL, events=loose, end=5.0, stop=4.0),
        _on_floor("equal levels, load at them", 2.0, EQUAL),
        _on_floor("equal levels, load at them, moving", 2.0, EQUAL, velocity=1.0, end=1.0),
        _on_floor("no friction", -1.0, NONE, velocity=1.0, events=[(1.0, 1, -1)], end=-1.0),
        _on_floor("no friction, at rest", law=NONE),
    ]


def _normals() -> list[Edge]:
    drop, rise, dip = [(0, 10), (1, 10), (1, 0)], [(0, 0), (1, 0), (2, 10)], [(0, 10), (1, 0), (2, 10)]
    fall = [(0, 10), (20, -10)]
    # 2 N against 6 N at 1 s, falling by 6 N/s; then v' = 2 - 0.2 N
    released = 2 - 1 / 3
    # 1 N against 0.3 (10 - t), then v' = 1 - 0.2 (10 - t) until the contact opens
    freed = 10 - 10 / 3
    speeds = {t: (t - freed) - 0.1 * ((10 - freed) ** 2 - (10 - t) ** 2) for t in (freed, 9.5, 10.0)}
    return [
        _on_floor("relief", 2.0, normal=[(0, 20), (1, 20), (2, 0)], events=[(released, 0, 1)], end=2 / 3 - 2 / 9),
        _on_floor(
            "normal force that drops",
            2.0,
            normal=[(0, 10), (1, 10), (1, 5)],
            events=[(1.0, 0, 1)],
            end=1.0,
        ),
        _on_floor("drops to 0 without a load", normal=drop),
        _on_floor("drops to 0 under a load", -2.0, normal=drop, events=[(1.0, 0, -1)], end=-2.0),
        _on_floor("rises from 0 with a load below", [(1, 0), (2, 2.5)], normal=rise),
        _on_floor("rises from 0 with a load above", [(1, 0), (2, 4)], normal=rise, events=[(1.0, 0, 1)], end=1.0),
        _on_floor("touches 0 with its load", [(0, 2), (1, 0), (2, 2)], normal=dip),
        _on_floor("touches 0 without a load", normal=dip),
        _on_floor("negative, then positive, at rest", normal=[(0, -10), (2, 10)]),
        _on_floor("no normal force", 2.0, normal=0.0, way={0.5: 1.0}, end=4.0),
        _on_floor("falls through 0 without a load", normal=fall, stop=20.0),
        _on_floor(
            "falls through 0 under a load",
            1.0,
            normal=fall,
            events=[(freed, 0, 1)],
            way=speeds,
            end=speeds[10.0] + 10.0,
            stop=20.0,
        ),
        _on_floor(
            "jumps down and up",
            2.5,
            normal=[(0, 10), (1, 10), (1, 1), (2, 1), (2, 20), (3, 20)],
            events=[(1.0, 0, 1), (2 + 2.3 / 1.5, 1, 0)],
            way={1.5: 1.15, 2.0: 2.3, 2.6: 1.4},
            stop=4.0,
        ),
        _on_floor(
            "is gone for a second",
            1.0,
            normal=[(0, 10), (1, 10), (1, 0), (2, 0), (2, 10), (3, 10)],
            events=[(1.0, 0, 1), (3.0, 1, 0)],
            way={2.0: 1.0, 2.5: 0.5},
            stop=4.0,
        ),
    ]


def _drives() -> list[Edge]:
    """A body that lies on a belt."""

    def on_belt(name: str, velocity: Load, ends: tuple[str, str] = ("b", "belt"), **told: Any) -> Edge:
        rub = Contact("c", *ends, DRY, normal=10.0)
        return _edge(name, _body(), Drive("belt", velocity=_lines(velocity)), rub, **told)

    jump = [(0, 0), (1, 0), (1, 1), (3, 1)]
    return [
        on_belt("belt that jumps", jump, events=[(1.0, 0, -1), (1.5, -1, 0)], end=1.0, stop=3.0),
        on_belt(
            "belt that jumps, ends swapped",
            jump,
            ("belt", "b"),
            events=[(1.0, 0, 1), (1.5, 1, 0)],
            end=1.0,
            stop=3.0,
        ),
        on_belt("belt that takes along", [(0, 0), (1, 0), (2, 2.5), (3, 2.5)], end=2.5),
        on_belt(
            "belt that slips away",
            [(0, 0), (1, 0), (2, 4), (3, 4)],
            events=[(1.0, 0, -1), (3.0, -1, 0)],
            end=4.0,
            stop=4.0,
        ),
    ]


def _dwells() -> list[Edge]:
    """B = 3 - exp(-t/0.5), from the time the contact has rested at the start."""
    short = DryFriction(0.3, 0.2, dwell=0.1)
    # half of the rise left: B = 3 - exp(-2 t)/2; a ramp from 2.2 N meets it at 0.5 s, then v' = load - 2
    slope = 2 * (0.8 - 0.5 / math.e)
    return [
        _on_floor("rested long", 2.5, SLOW, rested=10.0),
        _on_floor("not rested", 2.5, SLOW, end=1.0),
        _on_floor("rested enough", 2.5, SLOW, rested=HALF + 1e-7),
        _on_floor("rested a little less", 2.5, SLOW, rested=HALF - 1e-7, end=1.0),
        _on_floor(
            "level that a ramp meets",
            [(0, 2.2), (2, 2.2 + 2 * slope)],
            SLOW,
            rested=HALF,
            events=[(0.5, 0, 1)],
            end=0.3 + 1.875 * slope,
        ),
        _on_floor(
            "reversal that slips on",
            -2.5,
            short,
            velocity=1.0,
            events=[(1 / 4.5, 1, -1)],
            end=-0.5 * (2 - 1 / 4.5),
        ),
    ]


def _turns() -> list[Edge]:
    """Reversals, and other coefficients backwards."""
    swapped = Contact("c", GROUND, "b", ODD, normal=10.0)
    return [
        _on_floor(
            "reversal under a load above the level",
            -5.0,
            velocity=1.0,
            events=[(1 / 7, 1, -1)],
            end=-3 * (2 - 1 / 7),
        ),
        _on_floor("stop under a load between the levels", -2.5, velocity=1.0, events=[(1 / 4.5, 1, 0)]),
        _on_floor("stop, stronger backwards", -4.5, ODD, velocity=1.0, events=[(1 / 6.5, 1, 0)]),
        _on_floor("breakaway, stronger backwards", -5.5, ODD, end=-3.0),
        _edge("stronger backwards, ends swapped", _body(), swapped, _push(-4.5), end=-5.0),
    ]


def _several() -> list[Edge]:
    """Contacts side by side and one above the other."""
    hub = Body("b", inertia=2.0)
    arms = [Body(f"a{i}", inertia=1.0) for i in range(3)]
    joints = [Contact(f"c{i}", f"a{i}", "b", DRY, normal=10.0) for i in range(3)]
    pair = (_floor(name="c1"), _floor(name="c2"))
    other = Contact("c2", GROUND, "b", DRY, normal=10.0)
    strong = _floor(EQUAL, 200.0, "c2")
    # 3 N, then 2 N below; 4.2 N between them: 5 N of 6 N at first, 4 N once the floor slips
    rider = Contact("seat", "rider", "b", DRY, normal=14.0)
    jump = _lines([(0, 0), (1, 0), (1, 5), (2, 5)])
    return [
        _edge(
            "three that tie",
            hub,
            *arms,
            *joints,
            _push([(0, 0), (2, 30)]),
            events=[(1.0, 0, -1)],
            of=("c0", "c1", "c2"),
            end=1.5 + (22.5 - 6.0) / 2,
        ),
        _edge(
            "two side by side",
            _body(),
            *pair,
            _push([(0, 0), (2, 12)]),
            events=[(1.0, 0, 1)],
            of=("c1", "c2"),
            end=5.0,
        ),
        _edge(
            "a weak and a strong one side by side",
            _body(),
            _floor(EQUAL, 20.0, "c1"),
            strong,
            _push([(0, 0), (100, 100)]),
            events=[(44.0, 0, 1)],
            of=("c1", "c2"),
            way={20.0: 0.0, 43.9: 0.0, 54.0: 50.0},
            end=200.0,
            stop=64.0,
        ),
        _edge("two side by side, stop", _body(1.0), *pair, events=[(0.25, 1, 0)], of=("c1", "c2")),
        Edge(
            "two side by side, one swapped, stop",
            Scene(_body(1.0), pair[0], other),
            2.0,
            [(0.25, "c1", 1, 0), (0.25, "c2", -1, 0)],
            {"b": {2.0: 0.0}},
        ),
        Edge(
            "two overloaded, of which one holds after all",
            Scene(_body(), Body("rider", inertia=1.0), _floor(), rider, Force("rider", jump)),
            3.0,
            [(1.0, "c", 0, 1)],
            {body: {1.0: 0.0, 2.0: 1.5, 3.0: 3.0} for body in ("b", "rider")},
        ),
    ]


def _opened() -> list[Edge]:
    """Open contacts whose acceleration starts at 0: they leave rest with the contact that lets go."""
    falling = DryFriction(0.3, 0.2, stribeck_velocity=0.3)
    ramp, later = _push([(0, 0), (2, 6)]), [(5, 0), (6, 1)]
    beside = Scene(_body(), ramp, _floor(falling), _floor(normal=later, name="idle"))
    bodies = (_body(), Body("q", inertia=1.0), Spring("b", "q", stiffness=5.0))
    idle = Contact("idle", "q", GROUND, DRY, normal=_lines(later))
    events = [(1.0, "c", 0, 1), (1.0, "idle", 0, 1)]
    return [
        Edge("open, beside a contact that lets go", beside, 2.0, events, {}),
        Edge("open, behind a spring", Scene(*bodies, _floor(), ramp, idle), 1.2, events, {}),
    ]


EDGES = (*_levels(), *_normals(), *_drives(), *_dwells(), *_turns(), *_several(), *_opened())


def _checked(edge: Edge, formulation: str, method: str) -> float:
    """Return the error of event times over the span, or of velocities over the largest."""
    times = sorted({edge.stop, *(t for speeds in edge.speeds.values() for t in speeds)})
    options = {"formulation": formulation, "method": method, "t_eval": times, **OPTIONS}
    result = simulate(edge.scene, (0.0, edge.stop), **options)
    for contact in edge.scene.contacts:
        free = result.normal(contact.name) <= 0
        require(not result.force(contact.name)[free].any(), f"{contact.name} is open and has a force")
    errors = [event_error(changes(result, opened=True), edge.events, edge.stop)]
    for body, speeds in edge.speeds.items():
        errors.append(worst(result.velocity(body), [speeds[t] for t in times]))
    return max(errors)


def over_edges(formulation: str, method: str) -> Tried:
    """Return the worst of all edge scenes."""
    items = ((edge.name, partial(_checked, edge, formulation, method)) for edge in EDGES)
    return try_each(items, limit=PATIENCE)


ROWS = [
    Row(
        "Extremes",
        f"edges/{formulation}" if method == "BDF" else f"edges-{method.lower()}/{formulation}",
        f"{len(EDGES)} edge scenes: loads that come to a level, jump through it or only touch it ({formulation})",
        "by hand",
        partial(over_edges, formulation, method),
        bound,
        tries="edge scenes",
        same=True,
    )
    for formulation, method, bound in METHODS
]
