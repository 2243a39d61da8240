"""Rows that compare the engines with each other, and with exact arithmetic where motions graze."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from mpmath import mp

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Scene,
    Spring,
    piecewise_linear,
    simulate,
    sine,
)
from stickslip.engines import MethodName
from validation.random_scenes import GRID, STOP, draw
from validation.rows import Row, Tried, Wrong, changes
from validation.tried import try_each

GRAZES, QUICK_GRAZES, INTEGRATED = 1000, 60, 30
TIGHT: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-14}
BOUND = 1e-8  # ten thousand times rtol: errors of single steps add up along a run, also through events

# A law whose lower level is out of reach.
UPPER = DryFriction(0.5, 0.4, mu_static_backward=2.0, mu_coulomb_backward=0.4)

CLOSEST, NEAREST = 1e-12, 1e-9  # how near to touching the grazes are, as parts of the level or velocity
PATIENCE = 120.0
SEED = 31


def _apart(method: MethodName, number: int) -> float:
    """Return how far velocities by CVODE are from those by series, over the largest."""
    # without curves motions are linear between events
    scene = draw(number).with_laws(lambda law: replace(law, stribeck_velocity=None))
    exact = simulate(scene, (0.0, STOP), t_eval=GRID, method="series")
    other = simulate(scene, (0.0, STOP), t_eval=GRID, method=method, **TIGHT)
    n = len(scene.bodies)
    return float(np.abs(other.y[:n] - exact.y[:n]).max()) / (float(np.abs(exact.y[:n]).max()) or 1.0)


def _scenes(method: MethodName, count: int) -> Tried:
    return try_each(((f"scene {n}", partial(_apart, method, n)) for n in range(count)), limit=PATIENCE)


# Grazes: each returns a scene, its span, the contact's first event in exact arithmetic (None for none)

Graze = tuple[Scene, float, float | None]


def _by_sine(random: np.random.Generator, excess: float) -> Graze:
    """A block that a sine about a constant load brings to its level of 5 N."""
    offset, frequency, phase = random.uniform(-2, 2), random.uniform(0.2, 3.0), random.uniform(-1.5, 1.4)
    amplitude = float((5 - mp.mpf(offset)) * (1 + mp.mpf(excess)))
    above = mp.mpf(amplitude) + mp.mpf(offset) - 5
    first = None
    if above > 0:
        first = float((mp.asin((5 - mp.mpf(offset)) / mp.mpf(amplitude)) - mp.mpf(phase)) / (2 * mp.pi * frequency))
    load = sine(amplitude, frequency, phase=phase, offset=offset)
    # half a period beyond the first peak, and before the next
    stop = float((mp.pi / 2 - mp.mpf(phase)) / (2 * mp.pi * frequency)) + 0.5 / frequency
    scene = Scene(
        Body("block", inertia=random.uniform(0.5, 2)),
        Contact("c", "block", GROUND, UPPER, normal=10.0),
        Force("block", load),
    )
    return scene, stop, first


def _by_spring(random: np.random.Generator, excess: float) -> Graze:
    """A mass that swings on a spring pulls a block with at most its level of 5 N, about."""
    inertia, stiffness = random.uniform(0.5, 2), random.uniform(0.5, 5)
    turn = mp.sqrt(mp.mpf(stiffness) / mp.mpf(inertia))
    velocity = float(5 * (1 + mp.mpf(excess)) * turn / mp.mpf(stiffness))
    peak = mp.mpf(stiffness) * mp.mpf(velocity) / turn
    first = float(mp.asin(5 / peak) / turn) if peak > 5 else None
    scene = Scene(
        Body("block", inertia=1.0),
        Body("mass", inertia=inertia, velocity=velocity),
        Contact("c", "block", GROUND, UPPER, normal=10.0),
        Spring("block", "mass", stiffness=stiffness),
    )
    return scene, float(mp.pi / turn), first


def _by_velocity(random: np.random.Generator, excess: float) -> Graze:
    """A block whose velocity falls to about 0 and rises again: a rising load overcomes its friction of 4 N.

    ``m v' = F0 + F1 t - 4``, and ``v`` is least where that is 0.
    """
    inertia, start, slope = random.uniform(0.5, 2), random.uniform(0.0, 2.0), random.uniform(1.0, 5.0)
    lack = 4 - mp.mpf(start)
    velocity = float(lack**2 / (2 * mp.mpf(slope) * mp.mpf(inertia)) * (1 - mp.mpf(excess)))
    # the load as the scene holds it, rounded at its end
    stop = float(2 * lack / mp.mpf(slope))
    last = float(mp.mpf(start) + mp.mpf(slope) * mp.mpf(stop))
    exact_slope = (mp.mpf(last) - mp.mpf(start)) / mp.mpf(stop)
    under = lack**2 - 2 * exact_slope * mp.mpf(inertia) * mp.mpf(velocity)
    first = float((lack - mp.sqrt(under)) / exact_slope) if under > 0 else None
    scene = Scene(
        Body("block", inertia=inertia, velocity=velocity),
        Contact("c", "block", GROUND, DryFriction(0.4, 0.4), normal=10.0),
        Force("block", piecewise_linear([0.0, stop], [start, last])),
    )
    return scene, 0.9 * stop, first


KINDS: dict[str, Callable[[np.random.Generator, float], Graze]] = {
    "sine": _by_sine,
    "spring": _by_spring,
    "velocity": _by_velocity,
}


def _graze(method: MethodName, kind: str, number: int) -> float:
    """Return the error of the first event, over the span; a graze that is decided the other way is wrong."""
    random = np.random.default_rng([SEED, number])
    excess = float(random.choice([-1.0, 1.0]) * 10 ** random.uniform(np.log10(CLOSEST), np.log10(NEAREST)))
    if method != "series":
        excess = NEAREST
    with mp.workdps(40):
        scene, stop, first = KINDS[kind](random, excess)
    found = changes(simulate(scene, (0.0, stop), method=method, **TIGHT))
    if (first is None) != (not found):
        raise Wrong(f"excess {excess:.3g}: first event {found[:1]}, in exact arithmetic {first}")
    # a level is passed with a slope proportional to the root of the excess: the smaller it is, the less sharp the time
    return 0.0 if first is None else abs(found[0][0] - first) / stop * abs(excess) ** 0.5


def _grazes(method: MethodName, count: int) -> Tried:
    numbered = enumerate(itertools.islice(itertools.cycle(KINDS), count))
    items = ((f"{kind} {n}", partial(_graze, method, kind, n)) for n, kind in numbered)
    return try_each(items, limit=PATIENCE)


def rows(scenes: int, quick: bool = False) -> list[Row]:
    """Return the rows: `scenes` random scenes, and grazes, fewer of these if `quick`."""
    row, count = partial(Row, "Engines against each other"), QUICK_GRAZES if quick else GRAZES
    return [
        *(
            row(
                f"engines-{method}",
                f"{scenes} random linear scenes: series against CVODE {method} at rtol 1e-12; velocities",
                "the same motion",
                partial(_scenes, method, scenes),
                BOUND,
                limit=60.0 + 10.0 * scenes,
                tries="random linear scenes",
                same=True,
            )
            for method in ("BDF", "Adams")
        ),
        row(
            "grazes",
            f"{count} random tangencies within 1e-9 of touching: event or none, its time times its slope",
            "exact arithmetic of 40 digits",
            partial(_grazes, "series", count),
            1e-13,
            limit=60.0 + 0.1 * count,
            tries="grazes",
        ),
        row(
            "grazes-integrated",
            f"{INTEGRATED} random motions that pass what they touch by 1e-9, by CVODE BDF at rtol 1e-12: the same",
            "exact arithmetic of 40 digits",
            partial(_grazes, "BDF", INTEGRATED),
            1e-11,
            tries="grazes",
        ),
    ]
