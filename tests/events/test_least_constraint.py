"""Rows at rest with loops among them, for which releasing one after another runs in a circle.

Where static and Coulomb coefficients are equal, the accelerations are those of Gauss' principle of least constraint:
bounded least squares, computed here from bodies, rows and loads alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gear,
    Mode,
    OneWay,
    Scene,
    Signal,
    SimulationError,
    Spring,
    Stop,
    piecewise_linear,
    simulate,
    sine,
)
from stickslip.model.arrays import Array

# name, bodies, their radii, and the level of a contact; 0 for a one-way clutch
Rows = list[tuple[str, str, str, float, float, float]]
WAYS = ({}, {"method": "BDF"}, {"formulation": "merged"}, {"formulation": "multiplier"})

NETWORK: Rows = [
    (name, a, b, 1.0, 1.0, level)
    for name, a, b, level in (
        ("c0", "b8", GROUND, 1.0),
        ("c3", "b1", "b9", 3.0),
        ("c4", "b1", "b11", 3.0),
        ("c5", "b8", GROUND, 3.7),
        ("c6", "b11", GROUND, 1.0),
        ("c7", "b9", GROUND, 1.0),
        ("c8", "b8", "b0", 1.0),
        ("c10", "b1", GROUND, 3.0),
        ("c14", "b1", GROUND, 3.0),
        ("c18", "b4", "b11", 2.0),
        ("c19", "b11", "b0", 3.0),
        ("c20", "b4", GROUND, 1.0),
        ("c21", "b8", "b7", 3.0),
        ("c22", "b9", "b0", 2.0),
    )
]
CLUTCHES: Rows = [
    ("o0", "b1", "b0", -1.3, 1.0, 0.0),
    ("c1", "b3", "b0", -2.0, 1.0, 3.0),
    ("c3", "b0", "b3", 1.0, -1.0, 1.0),
    ("c4", "b1", GROUND, 1.0, 1.0, 3.0),
    ("c5", "b1", "b3", 1.0, 1.0, 3.0),
    ("o6", "b1", GROUND, -2.0, 1.0, 0.0),
    ("c7", "b3", "b0", 1.0, 1.0, 2.0),
]
OF_NETWORK = {
    "b0": (1.0, 4.0),
    "b1": (1.0, 0.0),
    "b4": (1.0, 2.0),
    "b7": (1.0, 7.0),
    "b8": (1.0, 1.0),
    "b9": (1.0, 2.0),
    "b11": (1.0, 0.0),
}
OF_CLUTCHES = {"b0": (1.0, -2.0), "b1": (44.0, 8.0), "b3": (1.0, 6.0)}


def scene(bodies: dict[str, tuple[float, float]], rows: Rows, static: float = 1.0) -> Scene:
    links = [
        Contact(name, a, b, DryFriction(static * level, level), normal=1.0, radius_a=r, radius_b=s)
        if level
        else OneWay(name, a, b, radius_a=r, radius_b=s)
        for name, a, b, r, s, level in rows
    ]
    masses = [Body(name, inertia=mass) for name, (mass, _) in bodies.items()]
    return Scene(*masses, *links, *(Force(name, load) for name, (_, load) in bodies.items()))


def accelerations(bodies: dict[str, tuple[float, float]], rows: Rows) -> Array:
    """Return ``a = M^-1 (F - G^T r)`` with the forces r within their limits that make ``1/2 a^T M a`` least."""
    names = list(bodies)
    mass, load = np.array(list(bodies.values())).T
    G = np.zeros((len(rows), len(names)))
    for k, (_, a, b, r, s, _) in enumerate(rows):
        G[k, names.index(a)] += r
        if b != GROUND:
            G[k, names.index(b)] -= s
    levels = np.array([level for *_, level in rows])
    low, high = -levels, np.where(levels > 0, levels, 1e3)
    root = np.sqrt(mass)
    found = lsq_linear((G / root).T, load / root, bounds=(low, high), method="bvls", tol=1e-15).x
    a = np.asarray((load - G.T @ found) / mass)
    # the laws: a row that moves forward carries its upper limit, one that moves backward its lower limit
    for force, below, above, w in zip(found, low, high, G @ a, strict=True):
        assert abs(w) < 1e-9 or abs(force - (above if w > 0 else below)) < 1e-9
    return a


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    ("bodies", "rows"), [(OF_NETWORK, NETWORK), (OF_CLUTCHES, CLUTCHES)], ids=["network", "clutches"]
)
def test_loops_move_as_least_constraint_tells(
    bodies: dict[str, tuple[float, float]], rows: Rows, way: dict[str, Any]
) -> None:
    result = simulate(scene(bodies, rows), (0.0, 1e-3), **way)
    found = [result.velocity(name)[-1] / 1e-3 for name in bodies]
    assert found == pytest.approx(accelerations(bodies, rows), abs=1e-9)


def test_levels_that_fall_once_they_move_are_found_from_there() -> None:
    """With higher static levels b7 alone moves, against the Coulomb level of its contact: 7 - 3 N on 1 kg."""
    result = simulate(scene(OF_NETWORK, NETWORK, static=1.1), (0.0, 1e-3))
    moving = [row[0] for row in NETWORK if result.mode(row[0])[-1] != 0]
    assert moving == ["c21"]
    assert result.velocity("b7")[-1] == pytest.approx(4e-3, rel=1e-12)
    assert max(abs(result.force(name)[-1]) - 1.1 * level for name, *_, level in NETWORK) <= 1e-12


def contacts(ends: dict[str, tuple[str, str, Any]]) -> list[Contact]:
    """Contacts of some levels, equal at rest and in motion."""
    return [Contact(name, a, b, DryFriction(1.0, 1.0), normal=level) for name, (a, b, level) in ends.items()]


def line(start: float, slope: float) -> Signal:
    return piecewise_linear([0.0, 1.0], [start, start + slope])


@pytest.mark.parametrize("order", range(6))
@pytest.mark.parametrize("way", WAYS)
def test_all_levels_are_just_met_but_only_one_contact_lets_go(way: dict[str, Any], order: int) -> None:
    """The loads on 10 kg reach the level of c3 with 4 N/s; those of b1 reach what its contacts can hold, but fall.

    So all bodies move as one, a = 0.4 t. On b1 the contacts c0, c1 and c6 hold 1 - 4 t + 2 a of at most 1 + t. The
    order of the contacts does not matter.
    """
    links = contacts(
        {
            "c0": ("b0", "b1", 0.5),
            "c1": ("b1", "b2", line(0.0, 1.0)),
            "c2": ("b0", "b3", 2.0),
            "c3": (GROUND, "b0", 1.0),
            "c4": ("b2", "b0", 1.0),
            "c5": ("b3", "b2", 2.0),
            "c6": ("b3", "b1", 0.5),
        }
    )
    links = [links[k] for k in np.random.default_rng(order).permutation(7)] if order else links
    masses = [Body(f"b{k}", inertia=mass) for k, mass in enumerate((3.0, 2.0, 2.0, 3.0))]
    loads = Force("b0", line(2.0, -3.0)), Force("b1", line(-1.0, 4.0)), Force("b3", line(0.0, 3.0))
    result = simulate(Scene(*masses, *links, *loads), (0.0, 0.1), **way)
    assert [link.name for link in links if result.mode(link.name)[-1] != Mode.STUCK] == ["c3"]
    assert all(event.t == 0 for event in result.events)
    for body in masses:
        assert result.velocity(body.name)[-1] == pytest.approx(0.2 * 0.1**2, rel=1e-7, abs=0)


@pytest.mark.parametrize("way", WAYS)
def test_bodies_that_begin_to_move_together_are_told_from_roundoff(way: dict[str, Any]) -> None:
    """Three bodies have a = -3/2 + 4 t/3 and the fourth -3/2 + 2 t: all levels are just met at the start."""
    links = contacts(
        {
            "c0": ("b2", "b1", 0.5),
            "c1": ("b2", "b3", 1.0),
            "c2": ("b0", "b3", 1.5),
            "c3": ("b1", "b2", 6.0),
            "c4": ("b0", "b2", 3.0),
            "c5": ("b2", "b0", line(0.0, 2.0)),
        }
    )
    masses = [Body(f"b{k}", inertia=1.0) for k in range(4)]
    loads = Force("b1", -4.0), Force("b2", line(-3.0, 4.0)), Force("b3", line(1.0, 2.0))
    result = simulate(Scene(*masses, *links, *loads), (0.0, 0.05), **way)
    found = [result.velocity(body.name)[-1] for body in masses]
    assert found == pytest.approx([-0.075 + 0.0025 * slope for slope in (2 / 3, 2 / 3, 2 / 3, 1.0)], rel=1e-7)


@pytest.mark.parametrize("way", WAYS)
def test_seven_contacts_that_a_drive_tears_apart(way: dict[str, Any]) -> None:
    """Three bodies of 6 kg move together, with loads of 2 + 4 t: c0, c2 and c5 slow them down, c4 pushes.

    Then 6 a = 2 + 4 t - (3 - 3 t) - (6 - 2 t) - 2 t + (1 - t), or a = -1 + t; the drive has -1.
    """
    links = contacts(
        {
            "c0": ("d", "b2", line(3.0, -3.0)),
            "c2": ("b1", "d", line(6.0, -2.0)),
            "c4": ("b2", "b3", line(1.0, -1.0)),
            "c5": ("b0", "d", line(0.0, 2.0)),
            "c6": ("b0", "b1", 2.0),
            "c8": ("b2", "b1", line(1.0, 0.5)),
            "c9": (GROUND, "b3", 4.0),
        }
    )
    masses = [Body(f"b{k}", inertia=mass) for k, mass in enumerate((2.0, 1.0, 3.0, 2.0))]
    loads = Force("b1", 4.0), Force("b2", line(-2.0, 4.0))
    result = simulate(Scene(*masses, Drive("d", velocity=line(0.0, -1.0)), *links, *loads), (0.0, 0.01), **way)
    found = [result.velocity(body.name)[-1] for body in masses]
    assert found == pytest.approx([-0.00995, -0.00995, -0.00995, 0.0], rel=1e-6, abs=1e-9)
    assert {link.name: int(result.mode(link.name)[-1]) for link in links} == {
        "c0": -1, "c2": 1, "c4": -1, "c5": 1, "c6": 0, "c8": 0, "c9": 0,
    }  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
def test_a_clutch_that_a_drive_presses_against_a_stop_does_not_run_forward(way: dict[str, Any]) -> None:
    """The clutch allows v >= 0 only, and the stop v <= -2 t: seven contacts beside them do not make that possible."""
    links = contacts(
        {
            "c0": ("b", "back", 0.5),
            "c1": (GROUND, "b", 0.5),
            "c2": ("b", GROUND, 1.0),
            "c3": ("back", "b", 0.5),
            "c4": ("b", GROUND, 1.0),
            "c5": ("b", GROUND, 1.0),
            "c6": ("b", "ahead", 1.0),
        }
    )
    drives = Drive("back", velocity=line(0.0, -2.0)), Drive("ahead", velocity=line(0.0, 1.0))
    clutch, stop = OneWay("clutch", GROUND, "b"), Stop("stop", "b", "back", lower=-1.0, upper=0.0)
    with pytest.raises(SimulationError, match="'clutch', 'stop' are pressed together") as caught:
        simulate(Scene(Body("b", inertia=1.0), *drives, *links, clutch, stop), (0.0, 0.5), **way)
    assert caught.value.t == 0


def test_random_networks_move_as_least_constraint_tells() -> None:
    """With whole levels and loads many rows come to their levels exactly."""
    for seed in range(60):
        random = np.random.default_rng(seed)
        names = [f"b{k}" for k in range(int(random.integers(2, 8)))]
        bodies = {name: (float(random.integers(1, 5)), float(random.integers(-6, 7))) for name in names}
        rows: Rows = []
        for k in range(int(random.integers(2, 13))):
            a, b = random.permutation([*names, GROUND])[:2].tolist()
            a, b = (b, a) if a == GROUND else (a, b)
            level = float(random.integers(1, 5)) if random.random() < 0.8 else 0.0
            rows.append((f"c{k}", a, b, *random.choice([1.0, 1.0, -1.0, 2.0], 2).tolist(), level))
        result = simulate(scene(bodies, rows), (0.0, 1e-3))
        exact = accelerations(bodies, rows)
        found = [result.velocity(name)[-1] / 1e-3 for name in names]
        assert found == pytest.approx(exact, abs=1e-6), seed


@pytest.mark.parametrize("way", WAYS)
def test_a_drive_pulls_where_all_other_contacts_just_hold(way: dict[str, Any]) -> None:
    """c1 pulls b0 with 2 N until the belt turns round at 1.5 s: with its load of 1 - 3 t the others must hold 3 - 3 t.

    At the start c4 and c5 can hold just that, and c3 just holds the load of -2 + t on b1, if c0 and c2 take all that
    they can. So no body moves, and at 1.5 s the belt pulls b0 backward.
    """
    links = contacts(
        {
            "c0": ("b1", "b3", 1.0),
            "c1": ("b0", "belt", 2.0),
            "c2": (GROUND, "b3", 1.0),
            "c3": ("b1", "b2", 1.0),
            "c4": ("b0", "b2", 1.0),
            "c5": (GROUND, "b0", 2.0),
            "c6": ("b2", GROUND, piecewise_linear([0.0, 2.0], [0.0, 2.0])),
        }
    )
    masses = [Body(f"b{k}", inertia=mass) for k, mass in enumerate((1.0, 1.0, 1.0, 2.0))]
    belt = Drive("belt", velocity=piecewise_linear([0.0, 1.0, 2.0], [0.0, 2.0, -2.0]))
    loads = (
        Force("b0", piecewise_linear([0.0, 1.0, 2.0], [1.0, -2.0, -2.0])),
        Force("b1", piecewise_linear([0.0, 1.0, 2.0], [-2.0, -1.0, 1.0])),
    )
    result = simulate(Scene(*masses, belt, *links, *loads), (0.0, 1.6), **way)
    assert {(event.contact, int(event.after)) for event in result.events} == {("c1", 1), ("c4", -1), ("c5", 1)}
    assert [event.t for event in result.events] == pytest.approx([1.5] * 3, abs=1e-9)
    assert max(np.abs(result.velocity(body.name)[result.t < 1.4]).max() for body in masses) == 0


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    "velocity", [sine(-1.0, 0.25) + sine(2.0, 0.125), sine(-1.0, 0.25, phase=0.5 * np.pi, offset=1.0)]
)
def test_a_belt_that_begins_smoothly_slips_from_the_start(velocity: Signal, way: dict[str, Any]) -> None:
    """The belt pushes b1 with 1 N against a load of 1 + t: the ground holds the rest up to its level of 0.5 N."""
    scene = Scene(
        Body("b0", inertia=1.0),
        Body("b1", inertia=2.0),
        Drive("belt", velocity=velocity),
        *contacts({"c0": ("b0", "b1", line(0.0, 1.0)), "ground": (GROUND, "b1", 0.5), "friction": ("belt", "b1", 1.0)}),
        OneWay("clutch", "b0", GROUND),
        Stop("stop", "b0", GROUND, lower=-1.0, upper=0.0, restitution=0.0),
        Force("b1", line(-1.0, -1.0)),
    )
    result = simulate(scene, (0.0, 0.6), **way)
    assert result.mode("friction")[0] == Mode.FORWARD
    (first,) = [event.t for event in result.events if event.contact == "ground"]
    assert first == pytest.approx(0.5, abs=1e-9)
    assert np.abs(result.velocity("b1")[result.t < 0.49]).max() == 0


@pytest.mark.parametrize("way", WAYS)
def test_a_drive_that_turns_round_tears_contacts_off_a_gear_at_its_stop(way: dict[str, Any]) -> None:
    """The belt comes to 0 at 5/3 s with 3 m/s2, and turns the load on b1 round: then v0 = v1 = v2 / 2.

    With the forces of 1 N of c1 and c2 on b1, that of c1 on b2, the spring with S = x_q + 0.3 v_q on b2 and -1 N on b0
    the equation of power is (2 + 1 + 4) v0' = -1 + 2 + 2 (S - 1).
    """
    t = 5.0 / 3.0
    scene = Scene(
        Body("b0", inertia=2.0),
        Body("b1", inertia=1.0),
        Body("b2", inertia=1.0),
        Drive("belt", velocity=piecewise_linear([0.0, 0.5, 1.0, 2.0], [0.0, -2.0, -2.0, 1.0])),
        Drive("q", velocity=sine(0.5, 1.0, phase=-0.5 * np.pi, offset=0.5)),
        *contacts({"c1": ("b1", "b2", 1.0), "c2": ("b1", "belt", 1.0), "c4": ("b1", "b0", 2.0)}),
        Gear("gear", "b2", "b0", ratio=2.0),
        Stop("stop", GROUND, "b0", lower=-1.0, upper=0.0, restitution=0.0),
        Spring("b2", "q", stiffness=1.0, damping=0.3),
        Force("b0", piecewise_linear([0.0, 1.0, 2.0], [-2.0, -1.0, -1.0])),
    )
    result = simulate(scene, (0.0, t + 1e-4), **way)
    assert {event.contact: int(event.after) for event in result.events if event.t > 1.6} == {
        "c1": Mode.BACKWARD, "c2": Mode.BACKWARD, "stop": Mode.OPEN,
    }  # fmt: skip
    pulls = 0.5 * t - 0.25 / np.pi * np.sin(2 * np.pi * t) + 0.3 * (0.5 - 0.5 * np.cos(2 * np.pi * t))
    assert result.velocity("b0")[-1] / 1e-4 == pytest.approx((2 * pulls - 1) / 7, rel=2e-3)


@pytest.mark.parametrize("way", WAYS)
def test_a_row_that_carries_its_level_lets_go_after_those_that_held_it(way: dict[str, Any]) -> None:
    """First c1 and the gear hold b0, and the clutch carries nothing; then c1 slips: b0 moves as -3 t / 2 + 3 t^2.

    At 0.5 s it is at rest again, where the clutch locks it; c1 then holds the rest: the load comes to 4 N at 1 s.
    """
    rows = (
        Contact("c0", "b1", "b2", DryFriction(1.0, 0.5), normal=2.0),
        Contact("c1", "b1", "b0", DryFriction(0.5, 0.25), normal=2.0),
        Gear("gear", "b1", "b2", ratio=-1.0),
        OneWay("clutch", "b0", GROUND),
        OneWay("between", "b1", "b2"),
    )
    masses = [Body("b0", inertia=1.0), Body("b1", inertia=2.0), Body("b2", inertia=1.0)]
    scene = Scene(*masses, *rows, Force("b0", line(-2.0, 6.0)), Force("b1", -2.0))
    result = simulate(scene, (0.0, 0.8), t_eval=[0.0, 0.2, 0.4, 0.6, 0.8], **way)
    assert result.velocity("b0") == pytest.approx([0.0, -0.18, -0.12, 0.0, 0.0], abs=1e-7)
    assert result.mode("clutch")[[1, 2, 3, 4]].tolist() == [-1, -1, 0, 0]
    assert np.abs(result.velocity("b1")).max() == 0


def work(r: Array, G: Array, led: Array, load: Array, mass: Array) -> tuple[float, Array]:
    """Return what the forces of rows make least, and its gradient."""
    a = (load - G.T @ r) / mass
    return float(0.5 * a @ (mass * a) - r @ led), -G @ a - led


def test_random_networks_between_drives_move_as_least_constraint_tells() -> None:
    """The forces within their limits make ``1/2 a^T M a - r^T D u'`` least, with ``a = M^-1 (F - G^T r)``."""
    for seed in range(40):
        random = np.random.default_rng(seed)
        n, count, u = int(random.integers(1, 5)), int(random.integers(2, 10)), random.integers(-2, 3, 2).astype(float)
        mass, load = random.integers(1, 4, n).astype(float), random.integers(-3, 4, n).astype(float)
        level, signs = random.integers(1, 4, count).astype(float), np.zeros((count, n + 3))
        names, links = [*(f"b{k}" for k in range(n)), "d0", "d1", GROUND], []
        for k in range(count):
            a, b = int(random.integers(n)), int(random.integers(n + 3))
            b = b if a != b else n + 2
            signs[k, [a, b]] = 1.0, -1.0
            links.append(Contact(f"c{k}", names[a], names[b], DryFriction(1.0, 1.0), normal=level[k]))
        G, led = signs[:, :n], signs[:, n : n + 2] @ u

        bounds = list(zip(-level, level, strict=True))
        options = {"ftol": 0.0, "gtol": 1e-12, "maxiter": 100_000, "maxfun": 100_000}
        r = minimize(
            work, np.zeros(count), (G, led, load, mass), jac=True, bounds=bounds, method="L-BFGS-B", options=options
        ).x
        masses = [Body(f"b{k}", inertia=m) for k, m in enumerate(mass)]
        drives = [Drive(f"d{k}", velocity=line(0.0, float(rate))) for k, rate in enumerate(u)]
        loads = [Force(f"b{k}", f) for k, f in enumerate(load)]
        result = simulate(Scene(*masses, *drives, *links, *loads), (0.0, 1e-3))
        found = [result.velocity(body.name)[-1] / 1e-3 for body in masses]
        assert found == pytest.approx((load - G.T @ r) / mass, abs=1e-5), seed
