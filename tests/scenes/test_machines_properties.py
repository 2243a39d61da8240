"""What holds for every machine with ties, clutches, gaps and stops: random scenes, in the default engine."""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import null_space

from stickslip import Gear, Result, Scene, Tie, simulate
from validation.against_oracles import scene_of
from validation.machine_scenes import FAMILIES

CASES = [(family, number) for family in ("gaps", "stops", "machines") for number in (2, 6, 10)]
every_case = pytest.mark.parametrize(("family", "number"), CASES)


def drawn(family: str, number: int) -> dict[str, Any]:
    """A copy of the scene without bounces that accumulate, because their number depends on roundoff."""
    data = copy.deepcopy(FAMILIES[family][0](number))
    for row in data["rows"]:
        if row["kind"] == "stop" and row["e"] not in (0.0, 1.0):
            row["e"] = 0.0
    return data


def run(data: dict[str, Any], **options: Any) -> Result:
    stop = data["t_end"]
    return simulate(scene_of(data), (0.0, stop), t_eval=np.linspace(0.0, stop, 41), **options)


@cache
def plain_run(family: str, number: int) -> Result:
    """The run with which runs of changed scenes are compared, simulated once."""
    return run(drawn(family, number))


def told(result: Result, mark: str = "") -> list[tuple[str, int, int, float]]:
    """Events by row, in order."""
    events = [(e.contact + mark, int(e.before), int(e.after), e.t) for e in result.events]
    return sorted(events, key=lambda event: (event[0], event[3]))


def same(one: Result, other: Result, mark: str = "", scale: float = 1.0) -> None:
    """The same events, times to 1e-9 of the span; velocities to 1e-8 of the largest."""
    wanted, found = told(one, mark), told(other)
    assert [event[:3] for event in found] == [event[:3] for event in wanted]
    times = np.array([event[3] for event in wanted]) - np.array([event[3] for event in found])
    assert np.abs(times).max(initial=0.0) < 1e-9 * one.t[-1]
    largest = max(np.abs(one.velocity(body.name)).max() for body in one.scene.bodies)
    for body in one.scene.bodies:
        off = np.abs(other.velocity(body.name + mark) - scale * one.velocity(body.name))
        # an output may stand at an impact
        assert np.sort(off)[:-2].max() < 1e-8 * scale * max(largest, 1e-3)


@every_case
def test_names_do_not_matter(family: str, number: int) -> None:
    """Other names of bodies and rows, in the same order: the same to the bit."""
    data = drawn(family, number)
    plain = plain_run(family, number)
    assert plain.events

    def marked(on: dict[str, float]) -> dict[str, float]:
        return {name if name == "ground" else f"{name}!": c for name, c in on.items()}

    for body in data["bodies"]:
        body["name"] += "!"
    for row in data["rows"]:
        row["name"], row["on"] = row["name"] + "!", marked(row["on"])
    for spring in data["springs"]:
        spring["on"] = marked(spring["on"])
    for force in data["forces"]:
        force["body"] += "!"
    other = run(data)
    assert told(plain, "!") == told(other)
    for body in plain.scene.bodies:
        assert np.array_equal(plain.velocity(body.name), other.velocity(f"{body.name}!"))


@every_case
def test_order_does_not_matter(family: str, number: int) -> None:
    data = drawn(family, number)
    plain = plain_run(family, number)
    for elements in (data["bodies"], data["rows"], data["springs"], data["forces"]):
        elements.reverse()
    same(plain, run(data))


@every_case
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_units_of_mass_do_not_matter(family: str, number: int, scale: float) -> None:
    """All inertias, stiffnesses, forces and normal forces times a factor: the same velocities."""
    data = drawn(family, number)
    plain = plain_run(family, number)
    for body in data["bodies"]:
        if body["inertia"]:
            body["inertia"] *= scale
    for row in (*data["rows"], *data["springs"]):
        for key in ("normal", "k", "c"):
            if key in row:
                row[key] = scaled(row[key], scale)
    for force in data["forces"]:
        force["load"] = scaled(force["load"], scale)
    same(plain, run(data))


@every_case
@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_units_of_length_do_not_matter(family: str, number: int, scale: float) -> None:
    """All positions, velocities, limits, forces and normal forces times a factor: the same times."""
    data = drawn(family, number)
    plain = plain_run(family, number)
    for body in data["bodies"]:
        body["velocity"] = scaled(body["velocity"], scale)
        if "position" in body:
            body["position"] *= scale
    for row in data["rows"]:
        for key in ("normal", "lower", "upper"):
            if key in row:
                row[key] = scaled(row[key], scale)
    for force in data["forces"]:
        force["load"] = scaled(force["load"], scale)
    same(plain, run(data), scale=scale)


def scaled(load: Any, scale: float) -> Any:
    """A number, a list of points or a sine, its values times a factor."""
    if isinstance(load, dict):
        return load | {key: load[key] * scale for key in ("amplitude", "offset") if key in load}
    if isinstance(load, list):
        return [[t, scale * value] for t, value in load]
    return scale * load


@every_case
def test_energy_is_never_created(family: str, number: int) -> None:
    result = plain_run(family, number)
    ledger = result.energy()
    assert ledger.relative_error < 1e-10
    size = max(np.abs(ledger.kinetic).max(), np.abs(ledger.stored).max(), 1e-6)
    for heat in (*ledger.contacts.values(), *ledger.dampers.values(), *ledger.impacts.values()):
        assert np.diff(heat).min() > -1e-11 * size


@pytest.mark.parametrize("number", [3, 5, 8, 9])
@pytest.mark.parametrize("family", ["ties", "clutches", "stops", "machines"])
def test_ties_hold(family: str, number: int) -> None:
    """To the bit where all coefficients are 1 or -1, within roundoff elsewhere."""
    result = plain_run(family, number)
    held = (*result.scene.ties, *result.scene.gears)
    assert held
    for tie in held:
        parts = np.array([c * result.velocity(name) for name, c in tie.coefficients.items()])
        off = np.abs(parts.sum(axis=0)).max()
        unit = len(parts) == 2 and all(abs(c) == 1 for c in tie.coefficients.values())
        assert off == 0 if unit else off <= 4e-15 * max(np.abs(parts).max(), 1e-3)


@pytest.mark.parametrize("number", range(1, 9))
@pytest.mark.parametrize("family", ["gaps", "stops", "machines"])
def test_free_components_keep_their_momentum(family: str, number: int) -> None:
    """Without loads, ground and drives ``z M v`` stays for each motion z with ``G z = 0``, in which no row moves.

    This is the momentum, generalised for ties and radii; impacts, clutches and gaps do not change it.
    """
    data = drawn(family, number)
    names = [body["name"] for body in data["bodies"] if body["inertia"] is not None]
    data["bodies"] = [body for body in data["bodies"] if body["inertia"] is not None]
    for kind in ("rows", "springs"):
        data[kind] = [row for row in data[kind] if set(row["on"]) <= set(names)]
    data["forces"] = []
    scene = scene_of(data)
    G = np.array([[row["on"].get(name, 0.0) for name in names] for row in (*data["rows"], *data["springs"])])
    free = null_space(G) if len(G) else np.eye(len(names))
    result = simulate(scene, (0.0, data["t_end"]), t_eval=np.linspace(0.0, data["t_end"], 41))
    v = np.array([result.velocity(name) for name in names])
    inertia = np.array([body["inertia"] for body in data["bodies"]])
    momentum = free.T @ (inertia[:, None] * v)
    size = max(1e-3, float(np.abs(inertia[:, None] * v).max()))
    assert np.abs(momentum - momentum[:, :1]).max(initial=0.0) < 1e-11 * size


@pytest.mark.parametrize("ratio", [1.0, -1.0])
def test_trains_of_gears_of_ratio_1_turn_as_one_to_the_bit(ratio: float) -> None:
    data = drawn("stops", 3)
    for k in range(3):
        speed = 0.3 * ratio**k
        data["bodies"].append({"name": f"w{k}", "inertia": 0.3 + k, "velocity": speed, "position": 0.0})
    data["forces"].append({"body": "w2", "load": {"amplitude": 3.0, "frequency": 1.3}})
    scene = Scene(
        *scene_of(data).elements,
        Gear("g0", "w1", "w0", ratio=ratio),
        Gear("g1", "w2", "w1", ratio=ratio),
        Tie("loop", {"w2": 1.0, "w0": -1.0}),
    )
    result = simulate(scene, (0.0, data["t_end"]))
    assert np.ptp(result.velocity("w0")) > 0.01
    assert np.array_equal(result.velocity("w1"), ratio * result.velocity("w0"))
    assert np.array_equal(result.velocity("w2"), result.velocity("w0"))
