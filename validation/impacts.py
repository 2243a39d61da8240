"""Rows on impacts: random bodies that are struck at up to six rows at once, as `simulate` starts them."""

from __future__ import annotations

from functools import partial
from random import Random
from typing import Any

import numpy as np

from stickslip import SimulationError, simulate
from validation.against_oracles import scene_of
from validation.machine_motion import Machine
from validation.rows import Array, Row, Tried, require
from validation.tried import try_each

impact_row = partial(Row, "Machines")
RADII = (1.0, 1.0, -1.0, 0.5, 2.0)
SAME = 1e-9  # part of the largest velocity, and of the largest momentum, that counts as 0


def configuration(seed: int) -> dict[str, Any]:
    """Return two to seven bodies at rest or moving, with one to six stops, clutches and ties between them.

    Stops stand at a limit; those that move into it are hit. Drives move at constant velocity.
    """
    draw = Random(seed)
    names = [f"b{i}" for i in range(draw.randint(2, 7))]
    bodies: list[dict[str, Any]] = [
        {
            "name": name,
            "inertia": round(10 ** draw.uniform(-1, 1), 3),
            "velocity": round(draw.gauss(0, 1), 3),
            "position": 0.0,
        }
        for name in names
    ]
    bodies.append({"name": "drive", "inertia": None, "velocity": draw.choice([0.0, round(draw.gauss(0, 1), 3)])})
    rows: list[dict[str, Any]] = []
    for k in range(draw.randint(1, 6)):
        a, b = draw.sample(names, 2)
        if draw.random() < 0.3:
            b = draw.choice(["ground", "drive"])
        on = {a: draw.choice(RADII), b: -draw.choice(RADII)}
        kind = draw.choice(["stop", "stop", "stop", "one-way", "tie"])
        if kind == "tie" and b in names:
            rows.append({"kind": "tie", "name": f"r{k}", "on": on})
        elif kind == "one-way":
            rows.append({"kind": "one-way", "name": f"r{k}", "on": on})
        else:
            limits = draw.choice([{"lower": 0.0}, {"upper": 0.0}])
            restitution = draw.choice([0.0, 0.5, 0.8, 1.0])
            rows.append({"kind": "stop", "name": f"r{k}", "on": on, "e": restitution} | limits)
    data = {"bodies": bodies, "rows": rows, "springs": [], "forces": [], "t_end": 1.0}
    return _possible(data)


def _possible(data: dict[str, Any]) -> dict[str, Any]:
    """Give velocities that ties and clutches allow; clutches that still turn forward are turned round."""
    names = [body["name"] for body in data["bodies"]]
    free = [i for i, body in enumerate(data["bodies"]) if body["inertia"] is not None]
    v = np.array([float(body["velocity"]) for body in data["bodies"]])
    rows = {kind: [r for r in data["rows"] if r["kind"] == kind] for kind in ("tie", "one-way")}
    C = np.array([[r["on"].get(name, 0.0) for name in names] for r in rows["tie"]]).reshape(-1, len(names))
    v[free] -= np.linalg.pinv(C[:, free]) @ (C @ v)
    v[np.abs(v) < 1e-12] = 0.0
    for i in free:
        data["bodies"][i]["velocity"] = float(v[i])
    for row in rows["one-way"]:
        if sum(c * v[names.index(name)] for name, c in row["on"].items() if name != "ground") > 0:
            row["on"] = {name: -c for name, c in row["on"].items()}
    return data


def error(seed: int) -> float:
    """Return how far the velocities after an impact are from those found by trying all sets of rows.

    Besides: ties hold, one-sided rows do not pass their limits, no energy is made. Where no velocities satisfy the
    rows, an error must say so.
    """
    data = configuration(seed)
    machine = Machine(data)
    u, v = machine.speeds(0.0), machine.velocity(machine.q0, machine.speeds(0.0))
    at = {j: 1 if "upper" in r else -1 for j, r in enumerate(machine.rows) if r["kind"] == "stop"}
    w = machine.G @ v
    size = max(float(np.abs(v).max()), 1e-9)
    hit = [j for j, side in at.items() if side * w[j] > 1e-12 * size]
    try:
        right = machine.velocity(machine.struck(v, u, at, hit), u)
    except ValueError:
        try:
            simulate(scene_of(data), (0.0, 1e-3))
        except SimulationError as jammed:
            require("pressed together" in str(jammed), f"another error: {jammed}")
            return 0.0
        require(False, "an answer where no velocities satisfy the rows")
    result = simulate(scene_of(data), (0.0, 1e-3))
    after = np.array([result.velocity(name)[0] for name in machine.bodies])
    _check(machine, v, after, at)
    return float(np.abs(after - right).max()) / size


def _check(machine: Machine, v: Array, after: Array, at: dict[int, int]) -> None:
    size = max(float(np.abs(v).max()), 1e-9)
    w = machine.G @ after
    require(float(np.abs(machine.C @ after).max(initial=0.0)) <= 1e-12 * size, "a tie does not hold")
    for j, kind in enumerate(machine.kinds):
        turn = at.get(j, 1 if kind == "one-way" else 0)
        require(turn * w[j] <= SAME * size, f"{machine.names[j]} passes its limit with {w[j]:.3g}")
    if all(v[i] == 0 for i in machine.driven):
        energies = [0.5 * float((machine.mass * x**2).sum()) for x in (v, after)]
        require(energies[1] <= energies[0] * (1 + SAME), "energy is made")
    # momentum changes only by impulses of the rows: its part that no row can change stays
    G = np.vstack([machine.G, machine.C])[:, machine.free]
    change = (machine.mass * (after - v))[machine.free]
    left = change - G.T @ np.linalg.lstsq(G.T, change, rcond=1e-10)[0]
    require(float(np.abs(left).max(initial=0.0)) <= SAME * float(machine.mass.max()) * size, "momentum is lost")


def over_all(count: int) -> Tried:
    """Return the worst of configurations 1 to `count`."""
    return try_each(((f"impact {n}", partial(error, n)) for n in range(1, count + 1)), 10.0)


def rows(count: int) -> list[Row]:
    """Return the row: so many random impacts."""
    return [
        impact_row(
            "impacts",
            f"{count} random impacts at up to six rows at once: velocities after them over the largest before",
            "complementarity, by trying all sets of rows; validation.machine_motion",
            partial(over_all, count),
            1e-9,
            limit=60.0 + 0.2 * count,
            tries="random impacts",
        )
    ]
