"""Random scenes against the oracle: the same from either side, and differences are noticed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stickslip import Body, Contact, Drive, simulate
from stickslip.model.quantities import Expression
from validation import against_oracles, machine_scenes
from validation.against_oracles import (
    OF_CONTACTS,
    OF_MACHINES,
    difference,
    over_family,
    rows,
    scene_of,
    truth,
)
from validation.oracle import Solution, solve
from validation.oracle_scenes import FAMILIES
from validation.rows import Wrong


@pytest.mark.parametrize("family", FAMILIES)
def test_a_number_gives_the_same_scene_every_time(family: str) -> None:
    draw, what = FAMILIES[family]
    assert what
    assert draw(5) == draw(5) != draw(6)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_both_sides_get_the_same_scene(family: str) -> None:
    data = FAMILIES[family][0](3)
    scene = scene_of(data)
    for body in data["bodies"]:
        (same,) = (b for b in (*scene.bodies, *scene.drives) if b.name == body["name"])
        if body["inertia"] is None:
            assert isinstance(same, Drive)
        else:
            assert isinstance(same, Body)
            assert (same.inertia, same.velocity) == (body["inertia"], body["velocity"])
    contacts = {contact.name: contact for contact in scene.contacts}
    system = solve(data).system
    for j, contact in enumerate(data["contacts"]):
        same = contacts[contact["name"]]
        assert isinstance(same, Contact)
        assert (same.a, same.b) == (contact["a"], contact["b"])
        for t in np.linspace(0.0, data["t_end"], 7):
            load = same.normal.signal if isinstance(same.normal, Expression) else same.normal
            normal = max(float(load(t)), 0.0)
            assert max(system.loads(float(t), 0.0).normal[j], 0.0) == pytest.approx(normal, abs=1e-12)


def test_elements_come_in_other_orders() -> None:
    data = FAMILIES["wheels"][0](3)
    first, other = scene_of(data, 0), scene_of(data, 1)
    assert first.contacts != other.contacts
    assert set(first.contacts) == set(other.contacts)


@pytest.mark.parametrize("group", OF_CONTACTS)
def test_a_scene_agrees(group: str) -> None:
    assert truth("symmetric", 2).events
    assert difference("symmetric", group, 2) < 1e-7


def test_other_events_velocities_and_forces_are_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    right = truth("wheels", 3)
    assert right.events
    (t, contact, before, after), *others = right.events
    wrong = {
        "instead of": replace(right, events=others),
        "instead of \\[": replace(right, events=[(t, contact, before, -after or 1), *others]),
        "time": replace(right, events=[(t + 1e-5, contact, before, after), *others]),
        "force": replace(right, forces={name: force + 1.0 for name, force in right.forces.items()}),
    }
    for words, answer in wrong.items():
        monkeypatch.setattr(against_oracles, "truth", lambda *_, answer=answer: answer)
        with pytest.raises(Wrong, match=words):
            difference("wheels", "contact-force", 3)
    faster = replace(right, velocities={name: v + 1e-3 for name, v in right.velocities.items()})
    monkeypatch.setattr(against_oracles, "truth", lambda *_: faster)
    assert difference("wheels", "contact-force", 3) > 1e-4


@pytest.mark.slow
def test_a_scene_in_doubt_is_compared_up_to_there_and_counted() -> None:
    number = next(n for n in range(20) if truth("loops", n).doubt and truth("loops", n).t.size)
    answer = truth("loops", number)
    found: Solution = solve(FAMILIES["loops"][0](number))
    assert 0 < answer.stop < found.known < FAMILIES["loops"][0](number)["t_end"]
    tried = over_family("loops", "merged", number + 1)
    assert tried.wrong == tried.hung == 0
    assert "events" in tried.remark and "no longer unique" in tried.remark


@pytest.mark.slow
def test_a_scene_without_loops_has_one_answer() -> None:
    for number in range(4):
        answer = truth("trees", number)
        assert not answer.doubt
        assert not any(np.isnan(force).any() for force in answer.forces.values())


def test_rows_say_how_many() -> None:
    table = rows(7)
    assert len(table) == len(FAMILIES) * len(OF_CONTACTS) + len(machine_scenes.FAMILIES) * len(OF_MACHINES)
    assert all(row.what.startswith("7 scenes") and row.tries for row in table)


def test_the_oracle_and_the_package_agree_on_what_a_contact_is() -> None:
    data = {
        "bodies": [{"name": "b", "inertia": 2.0, "velocity": 1.0}],
        "contacts": [
            {
                "name": "c",
                "a": "ground",
                "b": "b",
                "mu_s": 0.3,
                "mu_c": 0.2,
                "mu_s_back": 0.6,
                "mu_c_back": 0.4,
                "tau": 0.0,
                "normal": 10.0,
            }
        ],
        "springs": [],
        "forces": [],
        "t_end": 1.0,
    }
    ((t, *modes),) = solve(data).events  # w = -v, so the backward coefficients: 4 N
    assert t == pytest.approx(0.5, abs=1e-14) and modes == ["c", -1, 0]
    (event,) = simulate(scene_of(data), (0.0, 1.0)).events
    assert event.t == pytest.approx(0.5, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("group", OF_CONTACTS)
@pytest.mark.parametrize(
    ("family", "number"),
    [("one-way", 26), ("closing", 18), ("closing-loops", 10), ("together", 3), ("pressed", 11)],
)
def test_scenes_that_differed(family: str, number: int, group: str) -> None:
    assert truth(family, number).t.size
    assert difference(family, group, number) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("group", OF_CONTACTS)
@pytest.mark.parametrize(
    ("family", "number"),
    [
        ("one-way", 54),
        ("one-way", 156),
        ("one-way", 178),
        ("one-way", 217),
        ("one-way", 251),
        ("together", 151),
    ],
)
def test_scenes_in_which_loops_share_what_they_hold(family: str, number: int, group: str) -> None:
    assert difference(family, group, number) < 1e-6
