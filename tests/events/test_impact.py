"""The impact law as a pure function: momentum, restitution and complementarity on random configurations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from stickslip import GROUND, Body, Drive, Force, OneWay, Planetary, Scene, Stop, Tie, simulate
from stickslip.equations.system import System
from stickslip.events.impact import Jammed, Struck, struck


def random_case(rng: np.random.Generator) -> tuple[System, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Up to seven bodies, up to six rows that take part at once: stops hit or closed, one-way clutches, ties."""
    n = int(rng.integers(2, 8))
    names = [f"b{k}" for k in range(n)]
    elements: list[Any] = [Body(name, inertia=float(10 ** rng.uniform(-1, 1))) for name in names]
    elements.append(Drive("drive", velocity=0.0))
    rows = int(rng.integers(1, 7))
    for k in range(rows):
        a, b = rng.choice(n, 2, replace=False)
        other = names[b] if rng.random() < 0.7 else str(rng.choice([GROUND, "drive"]))
        radii = {
            "radius_a": float(rng.choice([1, 1, -1, 0.5, 2])),
            "radius_b": float(rng.choice([1, 1, 0.3])),
        }
        kind = rng.choice(["stop", "stop", "stop", "one-way", "tie"])
        if kind == "stop":
            e = float(rng.choice([0, 0.5, 0.8, 1]))
            elements.append(Stop(f"r{k}", names[a], other, lower=-1, upper=1, restitution=e, **radii))
        elif kind == "one-way":
            elements.append(OneWay(f"r{k}", names[a], other, **radii))
        elif other not in (GROUND, "drive"):
            # a body that is tied has others to go with
            elements.append(Tie(f"r{k}", {names[a]: radii["radius_a"], other: -radii["radius_b"]}))
    system = System(Scene(*elements))
    u = np.array([float(rng.choice([0.0, rng.normal()]))])
    v = rng.normal(size=n)
    # before the impact ties hold, and locked clutches and closed stops do not move
    closed = system.is_tie | (system.is_one_way | system.is_stop) & (rng.random(system.m) < 0.3)
    v = system.balance(closed).project(v, u)
    w = system.G @ v + system.D @ u
    sides = np.where(system.is_stop, rng.choice([-1, 1], system.m), 0).astype(np.int8)
    # a stop that comes to its limit moves towards it
    moves = system.is_stop & (np.abs(w) > 1e-9)
    sides = np.where(moves, np.sign(w), sides).astype(np.int8)
    # a one-way clutch cannot turn forward
    wrong = system.is_one_way & (w > 1e-9)
    if wrong.any():
        v = system.balance(closed | wrong).project(v, u)
        w = system.G @ v + system.D @ u
        if np.any(system.is_one_way & (w > 1e-9)) or np.any(system.is_stop & (sides * w < -1e-9)):
            return random_case(rng)
        moves = system.is_stop & (np.abs(w) > 1e-9)
    return system, v, u, sides, moves


def checked(system: System, v: np.ndarray, u: np.ndarray, sides: np.ndarray, hit: np.ndarray) -> Struck:
    found = struck(system, v, u, u, sides, hit)
    size = np.abs(v).max() + np.abs(u).max() + 1e-12
    before, after = (system.G @ x + system.D @ u for x in (v, found.v))
    r = found.impulses
    turn = np.where(system.is_one_way, 1, sides)
    sided = turn != 0
    # momentum: each body's changes by the impulses on it and nothing else
    push = system.GT @ r
    assert np.abs(system.inertia * (found.v - v) + push).max() < 1e-10 * size * system.inertia.max()
    # one-sided rows only push, ties hold
    assert (turn[sided] * r[sided] >= 0).all()
    assert np.abs(after[system.is_tie]).max(initial=0.0) < 1e-11 * size
    assert (turn[sided] * after[sided] <= 1e-10 * size).all()
    # energy is never made: the drive's work is counted
    energy = 0.5 * (system.inertia * (found.v**2 - v**2)).sum()
    work = float((system.D.T @ r) @ u)
    assert energy - work <= 1e-10 * size**2 * system.inertia.max()
    # where no free clutch can start a second impact, Newton's law holds, complementary
    free_clutch = system.is_one_way & (before < -1e-9 * size)
    if not free_clutch.any():
        wanted = system.restitution * np.where(hit, np.maximum(turn * before, 0), 0)
        gap = -turn * after - wanted
        assert gap[sided].min(initial=0.0) > -1e-10 * size
        part = np.abs(r) * np.maximum(gap, 0)
        assert part[sided].max(initial=0.0) < 1e-9 * size**2 * system.inertia.max()
    return found


def possible(system: System, v: np.ndarray, u: np.ndarray, sides: np.ndarray, hit: np.ndarray) -> bool:
    """Whether any velocities satisfy all rows, by linear programming."""
    w = system.G @ v + system.D @ u
    turn = np.where(system.is_one_way, 1, sides).astype(float)
    wanted = system.restitution * np.where(hit, np.maximum(turn * w, 0), 0)
    sided = turn != 0
    limit = -wanted - turn * (system.D @ u)
    found = linprog(
        np.zeros(system.n),
        A_ub=(turn[:, None] * system.G)[sided],
        b_ub=limit[sided] - 1e-7,
        A_eq=system.G[system.is_tie] if system.is_tie.any() else None,
        b_eq=-(system.D @ u)[system.is_tie] if system.is_tie.any() else None,
        bounds=(None, None),
    )
    return found.status == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_a_thousand_random_impacts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    struck_ones = 0
    for _ in range(100):
        case = random_case(rng)
        try:
            found = checked(*case)
        except Jammed:
            assert not possible(*case)
            continue
        struck_ones += bool(found.impulses.any())
    assert struck_ones > 50


@pytest.mark.parametrize("ratios", [(1.7, 2.1), (2.0, 1.9), (2.3, 2.9), (2.5, 1.9)])
@pytest.mark.parametrize("ends", [("a", "b"), ("b", "a"), ("c", "b")])
def test_what_ties_hold_takes_no_part(ratios: tuple[float, float], ends: tuple[str, str]) -> None:
    """Two planetary gears make one of three shafts, so that a freewheel between two has nothing to do at the stop."""
    gears = (Planetary(f"p{r}", sun="c", carrier="b", ring="a", ratio=r) for r in ratios)
    shafts = (Body(name, inertia=1.0) for name in "abc")
    scene = Scene(*shafts, *gears, OneWay("free", *ends), Stop("end", "b", GROUND, upper=0.5), Force("b", 5.0))
    result = simulate(scene, (0.0, 2.0))
    assert result.position("b")[-1] == pytest.approx(0.5, abs=1e-12)
    assert np.abs(result.y[:3, -1]).max() < 1e-12
