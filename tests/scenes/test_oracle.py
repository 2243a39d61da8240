"""The event-driven oracle, against exact answers and against hand calculation."""

from __future__ import annotations

import ast
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from validation import oracle
from validation.oracle import solve
from validation.oracle_scenes import FAMILIES
from validation.oracle_signals import Lines, Sine, read

HERE = Path(__file__).parents[1]
PARTS = sorted(Path(oracle.__file__).parent.glob("oracle*.py"))


def block(load: Any, normal: Any = 10.0, velocity: float = 0.0, stop: float = 2.0, **contact: Any) -> dict[str, Any]:
    """A block of 1 kg on the floor that breaks loose at 3 N and slides at 2 N."""
    friction = {"name": "floor", "a": "block", "b": "ground", "mu_s": 0.3, "mu_c": 0.2, "normal": normal}
    return {
        "bodies": [{"name": "block", "inertia": 1.0, "velocity": velocity}],
        "contacts": [friction | contact],
        "forces": [{"body": "block", "load": load}],
        "t_end": stop,
    }


@pytest.mark.slow
def test_it_owes_nothing_to_the_package() -> None:
    assert len(PARTS) == 7
    for path in PARTS:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                names = [alias.name for alias in node.names] + [getattr(node, "module", None) or ""]
                assert not any(name.partition(".")[0] == "stickslip" for name in names), path.name
    code = "import validation.oracle, validation.oracle_scenes, sys; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in run.stdout.split()}
    assert "scipy" in loaded and not loaded & {"stickslip", "sksundae", "mpmath"}


@pytest.mark.parametrize("path", sorted((HERE / "reference").glob("*.json")), ids=lambda p: p.stem)
def test_a_reference_scene(path: Path) -> None:
    data = json.loads(path.read_text())
    answer, found = data["answer"], solve(data["scene"])
    assert not found.doubt and found.known == data["scene"]["t_end"]
    assert list(found.initial) == answer["initial_modes"]
    assert [list(e[1:]) for e in found.events] == [e[1:] for e in answer["events"]]
    assert [e[0] for e in found.events] == pytest.approx([e[0] for e in answer["events"]], abs=4e-13)
    velocities = np.array([found.velocity(t) for t in answer["t"]])
    assert np.abs(velocities - answer["v"]).max() < 3e-13


def test_a_block_breaks_loose_under_a_ramp_and_stops() -> None:
    # 3 N at 1 s; then v' = 3 (t - 1) + 1 until 2 s, v = 2.5 m/s; then v' = -2
    found = solve(block([[0, 0], [2, 6], [2, 0]], stop=4.0))
    assert [e[1:] for e in found.events] == [("floor", 0, 1), ("floor", 1, 0)]
    assert [e[0] for e in found.events] == pytest.approx([1.0, 3.25], abs=1e-14)
    assert found.velocity(2.0)[0] == pytest.approx(2.5, abs=1e-14)
    assert found.friction(0.5) == pytest.approx([1.5])
    assert found.friction(1.5) == pytest.approx([2.0])


def test_unloading_breaks_a_block_loose() -> None:
    found = solve(block(2.0, normal=[[0, 20], [2, 0]]))
    ((t, _, before, after),) = found.events
    assert (before, after) == (0, 1)
    assert t == pytest.approx(2 - 2 / 3, abs=1e-14)


def test_the_level_rises_while_a_block_rests() -> None:
    # B = 3 - exp(-t/0.5) reaches the load of 2.5 N after a rest of 0.5 ln 2 s: a longer rest before the start holds
    held = solve(block(2.5, tau=0.5, rested=0.5 * math.log(2.0) + 1e-6))
    slips = solve(block(2.5, tau=0.5, rested=0.5 * math.log(2.0) - 1e-6))
    assert (held.initial, slips.initial) == ((0,), (1,))
    assert held.velocity(2.0) == pytest.approx([0.0], abs=0.0)
    assert slips.velocity(2.0) == pytest.approx([1.0], abs=1e-14)


def test_coefficients_differ_backwards() -> None:
    sides = {"mu_s_back": 0.5, "mu_c_back": 0.4}
    assert solve(block(-4.5, **sides)).initial == (0,)
    assert solve(block(-5.5, **sides)).velocity(2.0) == pytest.approx([-3.0], abs=1e-14)


def test_an_open_contact_goes_where_its_body_goes() -> None:
    # w = 1 - 3 t + t^2
    found = solve(block([[0, -3], [4, 5]], normal=[[4, 0], [5, 10]], velocity=1.0, stop=4.0))
    assert [e[2:] for e in found.events] == [(1, -1), (-1, 1)]
    roots = [(3 - math.sqrt(5)) / 2, (3 + math.sqrt(5)) / 2]
    assert [e[0] for e in found.events] == pytest.approx(roots, abs=1e-13)


def test_two_bodies_lock_and_share_a_load() -> None:
    scene = {
        "bodies": [
            {"name": "a", "inertia": 1.0, "velocity": 2.0},
            {"name": "b", "inertia": 3.0, "velocity": 0.0},
        ],
        "contacts": [{"name": "c", "a": "a", "b": "b", "mu_s": 0.3, "mu_c": 0.2, "normal": 10.0}],
        "forces": [{"body": "a", "load": [[1, 0], [1, 2]]}],
        "t_end": 2.0,
    }
    found = solve(scene)  # w' = -2 - 2/3; then lambda = F m_b/(m_a + m_b)
    ((t, *modes),) = found.events
    assert t == pytest.approx(0.75, abs=1e-14) and modes == ["c", 1, 0]
    assert found.velocity(1.0) == pytest.approx([0.5, 0.5], abs=1e-14)
    assert found.friction(1.5) == pytest.approx([1.5], abs=1e-14)


@pytest.mark.slow
def test_a_curved_load_and_a_stribeck_curve_are_integrated() -> None:
    # friction 2 + exp(-|w|/0.5) from 3 N on: v' = -(2 + exp(-2 v)), so 2 v = ln((C exp(-4 t) - 1)/2)
    found = solve(block(0.0, velocity=1.0, vs=0.5, delta=1.0))
    constant = 2 * math.exp(2.0) + 1
    stop = math.log(constant / 3) / 4
    ((t, *_),) = found.events
    assert t == pytest.approx(stop, abs=1e-12)
    load = {"amplitude": 4.0, "frequency": 0.5}
    ((t, *_), *_) = solve(block(load)).events
    assert t == pytest.approx(math.asin(0.75) / math.pi, abs=1e-12)


def test_equal_contacts_go_together() -> None:
    scene = block([[0, 0], [2, 12]])
    scene["contacts"].append(scene["contacts"][0] | {"name": "other"})
    found = solve(scene)
    assert [e[1:] for e in found.events] == [("floor", 0, 1), ("other", 0, 1)]
    assert [e[0] for e in found.events] == pytest.approx([1.0, 1.0], abs=1e-14)
    assert found.friction(0.5) == pytest.approx([1.5, 1.5], abs=1e-13)


def test_contacts_hold_together_up_to_the_sum_of_their_levels() -> None:
    """3 N and 0.6 N: half each up to 1.2 N, then 0.6 N and the rest, up to 3.6 N."""
    scene = block([[0, 0], [2, 8]])
    scene["contacts"].append(scene["contacts"][0] | {"name": "weak", "normal": 2.0})
    found = solve(scene)
    assert [e[1:] for e in found.events] == [("floor", 0, 1), ("weak", 0, 1)]
    assert [e[0] for e in found.events] == pytest.approx([0.9, 0.9], abs=1e-14)
    assert found.friction(0.25) == pytest.approx([0.5, 0.5], abs=1e-12)
    assert found.friction(0.75) == pytest.approx([2.4, 0.6], abs=1e-12)


def test_a_freewheel_lets_go_as_the_load_turns() -> None:
    """Stuck while the load is backward, up to 1 s; then v = (t - 1)^2 / 2."""
    back = {"mu_s": 0.0, "mu_c": 0.0, "mu_s_back": 0.6, "mu_c_back": 0.5}
    found = solve(block([[0, -1], [2, 1]], **back))
    assert [e[1:] for e in found.events] == [("floor", 0, 1)]
    assert found.events[0][0] == pytest.approx(1.0, abs=1e-12)
    assert found.velocity(2.0) == pytest.approx([0.5], abs=1e-12)


def test_an_open_contact_at_rest_keeps_the_time_since_which_it_rests() -> None:
    # N = 10 N at 1 s, and B = 3 - exp(-t/0.5) N after a rest of t. At rest for 1 s it holds 2.865 N: 2.75 N, not 2.9 N.
    # At rest since 0.5 s, when it closes again, it would hold 2.632 N only.
    normal = [[0, 10], [0.4, 10], [0.4, -1], [0.5, -1], [0.5, 10]]
    found = solve(block([[1, 0], [1, 2.75]], normal=normal, tau=0.5))
    assert not found.events and found.velocity(2.0) == pytest.approx([0.0], abs=0.0)
    assert solve(block([[1, 0], [1, 2.9]], normal=normal, tau=0.5)).events == [(1.0, "floor", 0, 1)]


def test_slipping_friction_that_starts_at_the_level_lets_go() -> None:
    # m v' = 3 t - 2 - exp(-(v/0.5)^2) starts at 0 at 1 s
    found = solve(block([[0, 0], [2, 6]], vs=0.5, delta=2.0))
    assert not found.doubt
    ((t, *modes),) = found.events
    assert t == pytest.approx(1.0, abs=1e-14) and modes == ["floor", 0, 1]
    assert found.velocity(1.01)[0] == pytest.approx(1.5e-4, rel=1e-3)


def test_a_normal_force_of_the_way_opens_its_contact() -> None:
    """v' = -0.5 (1 - x): v^2 - (1 - x)^2/2 stays 8.5, and at x = 1 the contact opens; no event, it goes on slipping."""
    law = {"mu_s": 0.5, "mu_c": 0.5, "pressed_by": [["position", "block", -1.0]]}
    found = solve(block(0.0, normal=1.0, velocity=3.0, **law))
    assert not found.events and not found.doubt
    k = math.sqrt(0.5)
    (opening,) = [piece.start for piece in found.pieces if piece.start]
    assert opening == pytest.approx(math.atanh(k / 3) / k, abs=1e-14)
    assert found.velocity(2.0) == pytest.approx([math.sqrt(8.5)], abs=1e-13)
    assert found.friction(0.0) == pytest.approx([0.5]) and found.friction(1.0) == pytest.approx([0.0])


@pytest.mark.parametrize(
    ("lifter", "pressed_by"),
    [(block([], velocity=1.0), ["position", "lifter", -1.0]), (block(0.5), ["velocity", "lifter", -2.0])],
)
def test_a_block_that_another_one_unloads(lifter: dict[str, Any], pressed_by: list[Any]) -> None:
    """N = 4 - t: 1 N breaks loose at 2 s, v' = 1 - 0.4 N then, open from 4 s on: v(4) = 1.2, v(5) = 2.2."""
    scene = block(1.0, normal=4.0, mu_s=0.5, mu_c=0.4, pressed_by=[pressed_by], stop=5.0)
    scene["bodies"] += [lifter["bodies"][0] | {"name": "lifter"}]
    load = lifter["forces"][0]["load"]
    scene["forces"] += [{"body": "lifter", "load": load}] if load else []
    found = solve(scene)
    ((t, *modes),) = found.events
    assert t == pytest.approx(2.0, abs=1e-13) and modes == ["floor", 0, 1]
    assert [found.velocity(s)[0] for s in (4.0, 5.0)] == pytest.approx([1.2, 2.2], abs=1e-13)


def test_a_block_that_presses_itself_on_as_it_goes() -> None:
    """From rest at x = 0 under -1 N, N = -2 x: x'' = -1 - x, so x = cos t - 1, and it stays where it stops, at pi."""
    law = {"mu_s": 0.5, "mu_c": 0.5, "pressed_by": [["position", "block", -2.0]]}
    found = solve(block(-1.0, normal=0.0, stop=5.0, **law))
    assert found.initial == (-1,) and not found.doubt
    ((t, *modes),) = found.events
    assert t == pytest.approx(math.pi, abs=1e-13) and modes == ["floor", -1, 0]
    assert found.velocity(1.0) == pytest.approx([-math.sin(1.0)], abs=1e-13)


def test_a_block_at_rest_that_is_pressed_from_0_on() -> None:
    """N = t - 1: nothing holds up to 1 s, and nothing pushes; 1 N from 1.5 s on finds a level of 0.25 N."""
    law = {"mu_s": 0.5, "mu_c": 0.4, "pressed_by": [["velocity", "lifter", 1.0]]}
    scene = block([[1.5, 0.0], [1.5, 1.0]], normal=-1.0, stop=4.0, **law)
    scene["bodies"].append({"name": "lifter", "inertia": 1.0, "velocity": 0.0})
    scene["forces"].append({"body": "lifter", "load": 1.0})
    found = solve(scene)
    assert found.initial == (0,)
    # v' = 1 - 0.4 (t - 1) = 0 at 3.5 s: the block slows down after that
    assert [e[1:] for e in found.events] == [("floor", 0, 1)]
    assert found.events[0][0] == pytest.approx(1.5, abs=1e-14)
    assert found.velocity(3.5)[0] == pytest.approx(2.0 - 0.2 * (2.5**2 - 0.5**2), abs=1e-13)


def test_breaks_a_last_digit_apart_are_one() -> None:
    late = 0.1 + 0.2
    assert late > 0.3
    found = solve(block([[0.3, 0], [0.3, 2.5]], normal=[[late, 10], [late, 20], [1, 0]]))
    ((t, *_),) = found.events
    assert t == pytest.approx(1 - 0.7 * 2.5 / 6, abs=1e-14)


def test_where_nothing_moves_roundoff_is_no_motion() -> None:
    found = solve(FAMILIES["symmetric"][0](42))
    assert found.known > 0.95
    assert found.events[0][0] == pytest.approx(0.94845981, abs=1e-8)


def test_it_says_where_there_is_no_telling() -> None:
    # equal levels: let go at its level, the block does not accelerate
    found = solve(block([[0, 0], [1, 2], [2, 2]], mu_s=0.2))
    assert found.doubt == "a contact let go that does not accelerate"
    assert found.known == pytest.approx(1.0)


def test_signals() -> None:
    line = Lines(((1.0, -2.0), (2.0, 2.0), (2.0, 5.0)))
    assert [line.after(t, 0.0) for t in (0.0, 1.0, 1.5, 2.0)] == [
        (-2.0, 0.0),
        (-2.0, 4.0),
        (0.0, 4.0),
        (5.0, 0.0),
    ]
    assert line.after(1.5, 0.25) == (1.0, 4.0)
    assert line.pressed().points == ((1.0, 0.0), (1.5, 0.0), (2.0, 2.0), (2.0, 5.0))
    sine = read({"amplitude": 2.0, "frequency": 0.25, "offset": 3.0})
    assert isinstance(sine, Sine)
    assert sine.after(0.5, 0.5) == (5.0, pytest.approx(0.0, abs=1e-15))
    with pytest.raises(ValueError, match="negative"):
        Sine(2.0, 1.0).pressed()
