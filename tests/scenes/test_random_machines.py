"""Random machines against the oracle of machines, and that oracle against closed forms."""

from __future__ import annotations

from dataclasses import replace
from random import Random

import numpy as np
import pytest

from stickslip import Result, Scene, simulate
from validation.against_oracles import OF_MACHINES, difference, truth
from validation.machine_oracle import solve
from validation.machine_scenes import FAMILIES
from validation.part_by_part import machine


def test_the_oracle_finds_the_impacts_of_a_slider() -> None:
    """MODEL's slider: m = 1, mu g = 0.5, restitution 0.8, between 0 and 1."""
    data = {
        "bodies": [{"name": "m", "inertia": 1.0, "velocity": 5.0, "position": 0.5}],
        "rows": [
            {
                "kind": "contact",
                "name": "dry",
                "on": {"m": 1.0, "ground": -1.0},
                "mu_s": 0.5,
                "mu_c": 0.5,
                "normal": 1.0,
            },
            {
                "kind": "stop",
                "name": "walls",
                "on": {"m": 1.0, "ground": -1.0},
                "lower": 0.0,
                "upper": 1.0,
                "e": 0.8,
            },
        ],
        "t_end": 5.0,
    }
    found = solve(data)
    assert not found.doubt
    hits = [0.1005050633883347, 0.3572033884104603, 0.6926271833524003]
    hits += [1.146233217046369, 1.80978775573666, 3.178058493638328]
    assert [e[0] for e in found.events if e[1] == "walls"] == pytest.approx(hits, abs=1e-13)
    assert found.events[-1] == (pytest.approx(3.800109416415555, abs=1e-13), "dry", 1, 0)
    assert found.position(5.0)[0] == pytest.approx(0.096736837632, abs=1e-12)


def test_the_oracle_finds_the_touches_of_a_damped_gap() -> None:
    """The ElastoGap of the Modelica Standard Library."""
    gap = {"kind": "gap", "name": "g", "on": {"m": 1.0, "ground": -1.0}, "k": 10.0, "c": 1.5}
    data = {
        "bodies": [{"name": "m", "inertia": 1.0, "velocity": 0.0, "position": 2.0}],
        "rows": [gap | {"lower": -0.5, "upper": 0.5}],
        "t_end": 5.0,
    }
    found = solve(data)
    times = [0.583372882547, 0.875160816924, 1.896201370487, 2.404066200137, 3.425106753700, 4.309059291854]
    assert [e[0] for e in found.events] == pytest.approx(times, abs=1e-12)
    assert found.position(5.0)[0] == pytest.approx(-0.7078852940798114, abs=1e-12)


def test_the_oracle_locks_and_frees_a_clutch() -> None:
    """The OneWayClutch of the Modelica Standard Library before its other clutch is pressed.

    Then the shaft that runs ahead turns on at its speed.
    """
    on = {"in": 1.0, "out": -1.0}
    data = {
        "bodies": [
            {"name": "in", "inertia": 1.0, "velocity": -0.5},
            {"name": "out", "inertia": 1.0, "velocity": 0.0},
        ],
        "rows": [{"kind": "one-way", "name": "free", "on": on}],
        "forces": [{"body": "in", "load": {"amplitude": 10.0, "frequency": 3.0}}],
        "t_end": 0.45,
    }
    found = solve(data)
    assert not found.doubt
    assert [e[0] for e in found.events] == pytest.approx([0.0802800002413492, 1 / 6], abs=1e-12)
    lock, whole = 0.0802800002413492, 10.0 / (6.0 * np.pi)
    assert found.velocity(0.2)[1] == pytest.approx(0.5 * whole * (np.cos(6 * np.pi * lock) + 1), abs=1e-12)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_number_gives_the_same_machine_every_time(family: str) -> None:
    draw, what = FAMILIES[family]
    assert what
    assert draw(5) == draw(5) != draw(6)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_machine_agrees(family: str) -> None:
    number = next(n for n in range(1, 10) if len(truth(family, n).events) > 3)
    assert difference(family, "auto", number) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("group", list(OF_MACHINES)[1:])
def test_formulations_agree(group: str) -> None:
    assert difference("machines", group, 2) < 1e-6


@pytest.mark.parametrize("number", [27, 31])
def test_scenes_that_differed(number: int) -> None:
    """Once a clutch beside a loop was taken as at rest while it turned, and roundoff between two loops as a force."""
    assert difference("clutches", "auto", number) < 1e-11


@pytest.mark.slow
def test_rows_that_share_are_at_rest_however_the_search_came_there() -> None:
    """Once rows that share were let go one by one: a contact at its level beside two clutches came to rest again."""
    assert difference("machines", "auto", 228) < 1e-11


def told(result: Result, prefix: str) -> list[tuple[str, float, int, int]]:
    events = [e for e in result.events if e.contact.startswith(prefix)]
    return sorted((e.contact, e.t, int(e.before), int(e.after)) for e in events)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_machines_side_by_side_move_as_each_alone(seed: int) -> None:
    draw = Random(seed)
    families = [draw.choice(["radii", "ties", "clutches", "gaps", "opening"]) for _ in range(6)]
    parts = [machine(family, draw.randrange(1000), f"{k} ") for k, family in enumerate(families)]
    together = simulate(Scene(*[one for part in parts for one in part]), (0.0, 2.0))
    count = 0
    for k, part in enumerate(parts):
        right, found = told(simulate(Scene(*part), (0.0, 2.0)), f"{k} "), told(together, f"{k} ")
        assert [(name, before, after) for name, _, before, after in found] == [
            (name, before, after) for name, _, before, after in right
        ]
        np.testing.assert_allclose([e[1] for e in found], [e[1] for e in right], rtol=0, atol=1e-10)
        count += len(right)
    assert count == len(together.events) > 10


def test_what_drives_tear_leaves_loops_alone_that_no_drive_is_at() -> None:
    """Once roundoff of the forces in loops of clutches was taken for a drive that tears these loops, too."""
    torn, others = machine("radii", 859596, "a "), machine("clutches", 341547, "b ")
    together, alone = simulate(Scene(*others, *torn), (0.0, 2.0)), simulate(Scene(*torn), (0.0, 2.0))
    found, right = told(together, "a "), told(alone, "a ")
    assert [e[0] for e in found] == [e[0] for e in right]
    np.testing.assert_allclose([e[1] for e in found], [e[1] for e in right], rtol=0, atol=1e-10)


def test_where_ties_lock_everything_forces_are_roundoff_of_the_loads() -> None:
    assert difference("clutches", "auto", 96) < 1e-9


def test_a_stop_that_lets_go_is_at_its_limit() -> None:
    """A load that starts at 0 lifts the stop off: no impact follows, although by roundoff the stop begins in flight."""
    assert difference("stops", "BDF", 6) < 1e-6


def test_differences_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    right = truth("gaps", 2)
    assert right.t.size
    largest = max(np.abs(v).max() for v in right.velocities.values())
    wrong = replace(right, velocities={name: v + 0.1 * largest for name, v in right.velocities.items()})
    monkeypatch.setattr("validation.against_oracles.truth", lambda *_: wrong)
    assert difference("gaps", "auto", 2) > 0.05
