"""Edge scenes: loads that come to a level, jump through it or only touch it, worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
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
)
from validation.rows import FORMULATIONS, Change, Row, Tried, changes, event_error
from validation.tried import try_each

METHODS = tuple((f, m) for f in FORMULATIONS for m in ("BDF", "Adams") if (f, m) != ("multiplier", "Adams"))
OPTIONS: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-12}
BOUND, PATIENCE = 1e-7, 20.0
DRY = DryFriction(0.3, 0.2)
EQUAL = DryFriction(0.2, 0.2)
SLOW = DryFriction(0.3, 0.2, dwell=0.5)
ODD = DryFriction(0.3, 0.2, mu_static_backward=0.5, mu_coulomb_backward=0.4)
HALF = 0.5 * math.log(2.0)
"""Time in s after which SLOW has half of its rise left."""


@dataclass(frozen=True)
class Edge:
    """A scene, its events up to `stop`, and the velocities of bodies there."""

    name: str
    scene: Scene
    events: Sequence[Change] = ()
    final: dict[str, float] = field(default_factory=lambda: {"b": 0.0})
    stop: float = 2.0


def _body(velocity: float = 0.0) -> Body:
    return Body("b", inertia=1.0, velocity=velocity)


def _floor(law: DryFriction = DRY, normal: Signal | float = 10.0, name: str = "c", **more: Any) -> Contact:
    return Contact(name, "b", GROUND, law, normal=normal, **more)


def _load(*points: tuple[float, float]) -> Force:
    return Force("b", _lines(*points))


def _push(force: float) -> Force:
    return Force("b", force)


def _lines(*points: tuple[float, float]) -> Signal:
    return piecewise_linear([t for t, _ in points], [value for _, value in points])


def _on_drive(*points: tuple[float, float], swapped: bool = False) -> Scene:
    """Return a body that lies on a belt."""
    ends = ("belt", "b") if swapped else ("b", "belt")
    return Scene(_body(), Drive("belt", velocity=_lines(*points)), Contact("c", *ends, DRY, normal=10.0))


def _levels() -> list[Edge]:
    """The block breaks loose at 3 N and slides at 2 N."""
    loose = [(1.0, "c", 0, 1)]
    return [
        Edge("load at the level", Scene(_body(), _floor(), _push(3.0))),
        Edge("load above it", Scene(_body(), _floor(), _push(3.000001)), final={"b": 2.000002}),
        Edge("ramp to the level", Scene(_body(), _floor(), _load((0, 0), (1, 3)))),
        Edge("ramp that touches it", Scene(_body(), _floor(), _load((0, 0), (1, 3), (2, 0)))),
        Edge(
            "ramp through it at a break",
            Scene(_body(), _floor(), _load((0, 0), (1, 3), (2, 5))),
            loose,
            {"b": 2.0},
        ),
        Edge(
            "equal levels, ramp",
            Scene(_body(), _floor(EQUAL), _load((0, 0), (1, 2), (2, 4))),
            loose,
            {"b": 5.0},
            4.0,
        ),
        Edge("equal levels, load at them", Scene(_body(), _floor(EQUAL), _push(2.0))),
        Edge(
            "equal levels, load at them, moving",
            Scene(_body(1.0), _floor(EQUAL), _push(2.0)),
            final={"b": 1.0},
        ),
        Edge(
            "no friction",
            Scene(_body(1.0), _floor(DryFriction(0.0, 0.0)), _push(-1.0)),
            [(1.0, "c", 1, -1)],
            {"b": -1.0},
        ),
        Edge("no friction, at rest", Scene(_body(), _floor(DryFriction(0.0, 0.0)))),
    ]


def _normals() -> list[Edge]:
    drop = _lines((0, 10), (1, 10), (1, 0))
    rise, dip = _lines((0, 0), (1, 0), (2, 10)), _lines((0, 10), (1, 0), (2, 10))
    # 2 N against 6 N at 1 s, falling by 6 N/s; then v' = 2 - 0.2 N
    relief, released = _lines((0, 20), (1, 20), (2, 0)), 2 - 1 / 3
    return [
        Edge(
            "relief",
            Scene(_body(), _floor(normal=relief), _push(2.0)),
            [(released, "c", 0, 1)],
            {"b": 2 / 3 - 2 / 9},
        ),
        Edge(
            "normal force that drops",
            Scene(_body(), _floor(normal=_lines((0, 10), (1, 10), (1, 5))), _push(2.0)),
            [(1.0, "c", 0, 1)],
            {"b": 1.0},
        ),
        Edge("drops to 0 without a load", Scene(_body(), _floor(normal=drop))),
        Edge(
            "drops to 0 under a load",
            Scene(_body(), _floor(normal=drop), _push(-2.0)),
            [(1.0, "c", 0, -1)],
            {"b": -2.0},
        ),
        Edge("rises from 0 with a load below", Scene(_body(), _floor(normal=rise), _load((1, 0), (2, 2.5)))),
        Edge(
            "rises from 0 with a load above",
            Scene(_body(), _floor(normal=rise), _load((1, 0), (2, 4))),
            [(1.0, "c", 0, 1)],
            {"b": 1.0},
        ),
        Edge("touches 0 with its load", Scene(_body(), _floor(normal=dip), _load((0, 2), (1, 0), (2, 2)))),
        Edge("touches 0 without a load", Scene(_body(), _floor(normal=dip))),
        Edge("negative, then positive, at rest", Scene(_body(), _floor(normal=_lines((0, -10), (2, 10))))),
    ]


def _drives() -> list[Edge]:
    jump = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (3.0, 1.0))
    return [
        Edge("belt that jumps", _on_drive(*jump), [(1.0, "c", 0, -1), (1.5, "c", -1, 0)], {"b": 1.0}, 3.0),
        Edge(
            "belt that jumps, ends swapped",
            _on_drive(*jump, swapped=True),
            [(1.0, "c", 0, 1), (1.5, "c", 1, 0)],
            {"b": 1.0},
            3.0,
        ),
        Edge("belt that takes along", _on_drive((0, 0), (1, 0), (2, 2.5), (3, 2.5)), (), {"b": 2.5}),
        Edge(
            "belt that slips away",
            _on_drive((0, 0), (1, 0), (2, 4), (3, 4)),
            [(1.0, "c", 0, -1), (3.0, "c", -1, 0)],
            {"b": 4.0},
            4.0,
        ),
    ]


def _dwells() -> list[Edge]:
    """B = 3 - exp(-t/0.5), from the time the contact has rested at the start."""
    short = DryFriction(0.3, 0.2, dwell=0.1)
    # half of the rise left: B = 3 - exp(-2 t)/2; a ramp from 2.2 N meets it at 0.5 s, then v' = load - 2
    slope = 2 * (0.8 - 0.5 / math.e)
    ramp = _load((0, 2.2), (2, 2.2 + 2 * slope))
    return [
        Edge("rested long", Scene(_body(), _floor(SLOW, rested=10.0), _push(2.5))),
        Edge("not rested", Scene(_body(), _floor(SLOW), _push(2.5)), final={"b": 1.0}),
        Edge("rested enough", Scene(_body(), _floor(SLOW, rested=HALF + 1e-7), _push(2.5))),
        Edge(
            "rested a little less",
            Scene(_body(), _floor(SLOW, rested=HALF - 1e-7), _push(2.5)),
            final={"b": 1.0},
        ),
        Edge(
            "level that a ramp meets",
            Scene(_body(), _floor(SLOW, rested=HALF), ramp),
            [(0.5, "c", 0, 1)],
            {"b": 0.3 + 1.875 * slope},
        ),
        Edge(
            "reversal that slips on",
            Scene(_body(1.0), _floor(short), _push(-2.5)),
            [(1 / 4.5, "c", 1, -1)],
            {"b": -0.5 * (2 - 1 / 4.5)},
        ),
    ]


def _turns() -> list[Edge]:
    """Reversals, other coefficients backwards, and contacts side by side."""
    hub = Body("b", inertia=2.0)
    arms = [Body(f"a{i}", inertia=1.0) for i in range(3)]
    joints = [Contact(f"c{i}", f"a{i}", "b", DRY, normal=10.0) for i in range(3)]
    pair = (_floor(name="c1"), _floor(name="c2"))
    other = Contact("c2", GROUND, "b", DRY, normal=10.0)
    return [
        Edge(
            "reversal under a load above the level",
            Scene(_body(1.0), _floor(), _push(-5.0)),
            [(1 / 7, "c", 1, -1)],
            {"b": -3 * (2 - 1 / 7)},
        ),
        Edge(
            "stop under a load between the levels",
            Scene(_body(1.0), _floor(), _push(-2.5)),
            [(1 / 4.5, "c", 1, 0)],
        ),
        Edge("stop, stronger backwards", Scene(_body(1.0), _floor(ODD), _push(-4.5)), [(1 / 6.5, "c", 1, 0)]),
        Edge("breakaway, stronger backwards", Scene(_body(), _floor(ODD), _push(-5.5)), final={"b": -3.0}),
        Edge(
            "stronger backwards, ends swapped",
            Scene(_body(), Contact("c", GROUND, "b", ODD, normal=10.0), _push(-4.5)),
            final={"b": -5.0},
        ),
        Edge(
            "three that tie",
            Scene(hub, *arms, *joints, _load((0, 0), (2, 30))),
            [(1.0, f"c{i}", 0, -1) for i in range(3)],
            {"b": 1.5 + (22.5 - 6.0) / 2},
        ),
        Edge(
            "two side by side",
            Scene(_body(), *pair, _load((0, 0), (2, 12))),
            [(1.0, "c1", 0, 1), (1.0, "c2", 0, 1)],
            {"b": 5.0},
        ),
        Edge(
            "two side by side, stop",
            Scene(_body(1.0), *pair),
            [(0.25, "c1", 1, 0), (0.25, "c2", 1, 0)],
        ),
        Edge(
            "two side by side, one swapped, stop",
            Scene(_body(1.0), pair[0], other),
            [(0.25, "c1", 1, 0), (0.25, "c2", -1, 0)],
        ),
    ]


def _opened() -> list[Edge]:
    """Open contacts whose acceleration starts at 0: they leave rest with the contact that lets go."""
    falling = DryFriction(0.3, 0.2, stribeck_velocity=0.3)
    ramp, later = _load((0, 0), (2, 6)), _lines((5, 0), (6, 1))
    idle = Contact("idle", "q", GROUND, DRY, normal=later)
    events = [(1.0, "c", 0, 1), (1.0, "idle", 0, 1)]
    return [
        Edge(
            "open, beside a contact that lets go",
            Scene(_body(), ramp, _floor(falling), _floor(normal=later, name="idle")),
            events,
            {},
        ),
        Edge(
            "open, behind a spring",
            Scene(_body(), Body("q", inertia=1.0), Spring("b", "q", stiffness=5.0), _floor(), ramp, idle),
            events,
            {},
            1.2,
        ),
    ]


EDGES = (*_levels(), *_normals(), *_drives(), *_dwells(), *_turns(), *_opened())


def _checked(edge: Edge, formulation: str, method: str) -> float:
    """Return the error of event times over the span, or of velocities over the largest or 1 m/s."""
    result = simulate(edge.scene, (0.0, edge.stop), formulation=formulation, method=method, **OPTIONS)
    errors = [event_error(changes(result, opened=True), edge.events, edge.stop)]
    for body, velocity in edge.final.items():
        errors.append(abs(float(result.velocity(body)[-1]) - velocity) / max(abs(velocity), 1.0))
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
        BOUND,
        tries="edge scenes",
        same=True,
    )
    for formulation, method in METHODS
]
