"""Extremes of number: symmetric and simultaneous events, loops, long chains, long runs."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Scene,
    piecewise_linear,
    simulate,
)
from validation.blocks import DRY, block, extreme_row
from validation.exact import TIGHT
from validation.rows import FORMULATIONS, Answer, Row, asked, changes, event_error, require, worst


def symmetric(count: int) -> Answer:
    """Pairs of blocks thrown against a hub from both sides: all lock at once, and the hub never moves."""
    names = [f"{side}{i}" for i in range(count) for side in "+-"]
    scene = Scene(
        Body("hub", inertia=3.0),
        *(Body(n, inertia=2.0, velocity=1.0 if n[0] == "+" else -1.0) for n in names),
        *(Contact(f"c{n}", n, "hub", DRY, normal=10.0) for n in names),
        *(Force(n, (1.0 if n[0] == "+" else -1.0) * piecewise_linear([1.0, 2.0], [0.0, 10.0])) for n in names),
    )
    result = simulate(scene, (0.0, 2.0), t_eval=np.linspace(0.0, 2.0, 41))
    ways = {f"c{n}": 1 if n[0] == "+" else -1 for n in names}
    events = [(0.5, c, way, 0) for c, way in ways.items()] + [(1.5, c, 0, way) for c, way in ways.items()]
    error = event_error(changes(result), events, 2.0)
    require(len({e.t for e in result.events}) == 2, "simultaneous events have different times")
    require(not result.velocity("hub").any(), f"the hub moves at {np.abs(result.velocity('hub')).max():.1e}")
    return error


def together(count: int) -> Answer:
    """Equal blocks on a slowing belt all break loose in the same instant, and stick again in the same instant."""
    velocity = piecewise_linear([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 10.0, 10.0])
    scene = Scene(
        Drive("belt", velocity=velocity),
        *(Body(f"b{i}", inertia=1.0 + i % 3) for i in range(count)),
        *(Contact(f"c{i}", f"b{i}", "belt", DRY, normal=10.0 * (1 + i % 3)) for i in range(count)),
    )
    result = simulate(scene, (0.0, 5.0), t_eval=[1.0, 2.0, 3.0, 3.5, 5.0])
    # an acceleration of 10 needs more than mu_s g = 5; sliding gives 4: 4 (t - 1) = 10 at t = 3.5
    events = [(t, f"c{i}", *way) for t, way in ((1.0, (0, -1)), (3.5, (-1, 0))) for i in range(count)]
    error = event_error(changes(result), events, 5.0)
    v = [worst(result.velocity(f"b{i}"), [0.0, 4.0, 8.0, 10.0, 10.0]) for i in range(count)]
    return max(error, *v)


def loops(kind: str) -> Answer:
    """Forces in closed loops of stuck contacts: least norm among all that hold the motion, by pseudo-inverse."""
    random = np.random.default_rng(7)
    ends = {
        "doubled": [(0, 1), (0, 1), (1, 0), (1, 2)],
        "triangle": [(0, 1), (1, 2), (2, 0)],
        "grounded": [(0, 3), (1, 3), (0, 1), (1, 2)],
        "complete": [(i, j) for i in range(4) for j in range(i)],
    }[kind]
    bodies = 1 + max(e for pair in ends for e in pair) - (kind == "grounded")
    inertia, forces = random.uniform(0.5, 3.0, bodies), random.uniform(-1.0, 1.0, bodies)
    names = [f"b{i}" for i in range(bodies)] + [GROUND]
    scene = Scene(
        *(Body(names[i], inertia=float(m)) for i, m in enumerate(inertia)),
        *(Contact(f"c{k}", names[i], names[j], DRY, normal=100.0) for k, (i, j) in enumerate(ends)),
        *(Force(names[i], float(f)) for i, f in enumerate(forces)),
    )
    g = np.zeros((len(ends), bodies + 1))
    for k, (i, j) in enumerate(ends):
        g[k, i], g[k, j] = 1.0, -1.0
    g = g[:, :bodies]
    # all lambda with G M^-1 (F - G^T lambda) = 0; of these the shortest
    exact = np.linalg.pinv(g / inertia @ g.T, rcond=1e-10) @ (g / inertia @ forces)
    errors = []
    for f in FORMULATIONS:
        result = simulate(scene, (0.0, 1.0), **asked(f), t_eval=[0.0, 1.0], **TIGHT)
        found = np.array([result.force(f"c{k}") for k in range(len(ends))])
        errors.append(worst(found, np.column_stack([exact, exact])))
        require(not result.events, f"{f}: stuck contacts slip")
    return max(errors)


def chain(count: int) -> Answer:
    """Wheels in a row, each rubbing on the next, free at both ends: all end at the mean of their speeds."""
    i = np.arange(count)
    speeds = 1 + 0.01 * np.sin(7.3 * i)
    normals = 100 * (1 + 0.5 * np.sin(3.1 * i))
    law = DryFriction(0.2, 0.1)
    scene = Scene(
        *(Body(f"w{k}", inertia=1.0, velocity=float(v)) for k, v in enumerate(speeds)),
        *(Contact(f"c{k}", f"w{k}", f"w{k + 1}", law, normal=float(normals[k])) for k in range(count - 1)),
    )
    stop = 0.5 * max(count, 10) / 10
    result = simulate(scene, (0.0, stop), t_eval=[0.5 * stop, stop], dense_output=False)
    final = result.y[:count, -1]
    momentum = np.abs(result.y[:count].mean(axis=0) - speeds.mean()).max()
    return max(float(np.abs(final - speeds.mean()).max()), float(momentum)), f"{len(result.events)} events"


def many_events(count: int) -> Answer:
    """6 N for a second, nothing for a second, again and again: it breaks loose at 2 k and stops at 2 k + 1.5 s."""
    cycles = count // 2
    times = np.repeat(np.arange(2.0 * cycles + 1), 2)[1:-1]
    load = piecewise_linear(times, np.tile([6.0, 6.0, 0.0, 0.0], cycles))
    events = [e for t in 2.0 * np.arange(cycles) for e in ((t, "floor", 0, 1), (t + 1.5, "floor", 1, 0))]
    result = simulate(block(load), (0.0, float(count)), t_eval=[float(count)], dense_output=False)
    # it slips from the start
    return event_error(changes(result), events[1:], 1.0), f"{len(result.events)} events, errors in s"


def _rows() -> Iterator[Row]:
    for count in (1, 4):
        yield extreme_row(
            f"symmetry-{2 * count}",
            f"{2 * count} blocks lock on a hub in the same instant and break loose in the same instant; the hub rests",
            "t = 0.5 s and 1.5 s; velocity of the hub 0, exactly",
            partial(symmetric, count),
            1e-14,
        )
    yield extreme_row(
        "together-12",
        "12 blocks on a belt break and stick in the same instants",
        "straight lines",
        partial(together, 12),
        1e-13,
    )
    for kind in ("doubled", "triangle", "grounded", "complete"):
        yield extreme_row(
            f"loop-{kind}",
            f"stuck contacts in closed loops ({kind}): forces, in three formulations",
            "least norm, by pseudo-inverse",
            partial(loops, kind),
            1e-8,
        )
    for count in (1, 2, 10, 100, 1000, 10_000):
        yield extreme_row(
            f"chain-{count}",
            f"{count} wheels in a row come to rest on each other: final speeds, and momentum on the way",
            "mean of the initial speeds",
            partial(chain, count),
            1e-12,
            quick=count < 1000,
            limit=60.0 if count < 10_000 else 1800.0,
        )
    for count in (1000, 100_000):
        yield extreme_row(
            f"events-{count}",
            f"{count} events in one run: time of each, in s",
            "2 k and 2 k + 1.5 s",
            partial(many_events, count),
            1e-14 * count,
            quick=count <= 1000,
            limit=900.0,
        )


ROWS = list(_rows())
