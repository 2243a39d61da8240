"""The oracle, against hand calculation, against itself by another way, and against the laws it must obey."""

import ast
import json
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from validation import analytic
from validation.analytic import Motion, exact, mp

HERE = Path(__file__).parents[1]
BENCHMARK = (  # time [s], contact, mode before, mode after
    ("0.000909090909090909", "interface", -1, 0),
    ("0.473006762576147516", "interface", 0, -1),
    ("0.527593338990130857", "brake", 1, 0),
    ("0.575899715052702889", "brake", 0, 1),
    ("0.653395901643388061", "interface", -1, 0),
)
FINAL_SPEED = "0.687838305725714362"


def near(a: Any, b: Any, digits: int = 30) -> bool:
    return bool(abs(exact(a) - exact(b)) <= mp.mpf(10) ** -digits)


def reference(name: str) -> dict[str, Any]:
    return json.loads((HERE / "reference" / f"{name}.json").read_text())


# The benchmark


@pytest.mark.parametrize(("event", "expected"), [*zip(analytic.two_flywheels().events, BENCHMARK, strict=True)])
def test_benchmark_event(event: analytic.Event, expected: tuple[str, str, int, int]) -> None:
    assert near(event.time, expected[0], 18)
    assert event[1:] == expected[1:]


def test_benchmark_velocities_at_its_events() -> None:
    motion = analytic.two_flywheels()
    lock, slip, stop, drag, relock = (event.time for event in motion.events)
    assert all(near(v, Fraction(111, 110)) for v in motion.velocity(lock))  # (1 + 10.1) / (1 + 10)
    assert near(*motion.velocity(slip))
    assert near(motion.velocity(stop)[0], 0) and near(motion.velocity(drag)[0], 0)
    assert all(near(v, FINAL_SPEED, 18) for v in (*motion.velocity(relock), *motion.velocity(4)))


# Reference answers


def test_reference_flywheels() -> None:
    answer, motion = reference("flywheels-2")["answer"], analytic.two_flywheels()
    assert [list(event[1:]) for event in motion.events] == [event[1:] for event in answer["events"]]
    for event, expected in zip(motion.events, answer["events"], strict=True):
        assert near(event.time, expected[0], 15)
    for t, row in zip(answer["t"], answer["v"], strict=True):
        assert all(near(v, expected, 15) for v, expected in zip(motion.velocity(t), row, strict=True))


def test_reference_pulled_block() -> None:
    block = analytic.pulled_block(1, 2, 0.1, normal=1, mu_static=1.5, mu_coulomb=1.0)
    answer = reference("pulled-block")["answer"]
    assert near(block.first_break, 7.5)  # 1.5 / (2 * 0.1)
    assert near(block.stick_time, 5)  # 2 * 0.5 / (2 * 0.1)
    assert near(block.slip_time, "2.61125925410131", 14)
    events = block.events(40)
    assert [list(event[1:]) for event in events] == [event[1:] for event in answer["events"]]
    for event, expected in zip(events, answer["events"], strict=True):
        assert near(event.time, expected[0], 14)
    for t, v, x in zip(answer["t"], answer["v"], answer["x"], strict=True):
        position, velocity = block.state(t)
        assert near(position, x[0], 14) and near(velocity, v[0], 14)


# What the motion must obey

BRAKE = [(0.05, 0), (0.1, 150), (0.15, 0), (0.4, 0), (0.5, 300), (0.6, 0)]


def braked(t: Any) -> Any:
    """The normal force of the brake."""
    for (t0, f0), (t1, f1) in pairwise(BRAKE):
        if exact(t0) <= t < exact(t1):
            return f0 + (f1 - f0) * (t - exact(t0)) / (exact(t1) - exact(t0))
    return mp.zero


def spans(motion: Motion) -> Iterator[tuple[Any, Any]]:
    """The times between which the motion has no kink."""
    marks = {mp.zero, mp.mpf(4), *(event.time for event in motion.events), *(exact(t) for t, _ in BRAKE)}
    return pairwise(sorted(marks))


def test_benchmark_obeys_the_laws() -> None:
    """Newton's law gives the contact forces, from the free end inwards; the friction law must allow them."""
    motion = analytic.two_flywheels()
    mode: dict[str, int] = {}
    since = dict.fromkeys(["brake", "interface"], mp.zero)
    events = list(motion.events)
    for a, b in spans(motion):
        while events and events[0].time <= a:
            event = events.pop(0)
            assert mode[event.contact] == event.before
            mode[event.contact], since[event.contact] = event.after, event.time
        for t in (a + (b - a) / 100, (a + b) / 2, b - (b - a) / 100):
            h = (b - a) / 200
            (v1, v2), ahead, behind = motion.velocity(t), motion.velocity(t + h), motion.velocity(t - h)
            # the central difference of a quadratic is its derivative
            p1, p2 = (m * (ahead[k] - behind[k]) / (2 * h) for k, m in enumerate((1, 10)))
            for name, r, w, normal in (("interface", p2, v1 - v2, 100), ("brake", -p1 - p2, v1, braked(t))):
                seen = int(mp.sign(w)) if abs(w) > 1e-25 else 0
                assert mode.setdefault(name, seen) == seen
                if seen:
                    assert abs(r - seen * normal / mp.mpf(10)) < 1e-12
                else:
                    risen = 2 - mp.exp(-10 * (t - since[name]))
                    assert abs(r) <= risen * normal / mp.mpf(10) + exact(1e-12)
    assert not events


def test_benchmark_keeps_momentum_and_energy() -> None:
    """The brake takes all lost momentum; the contacts turn all lost energy into heat."""
    motion = analytic.two_flywheels()
    momentum = energy = mp.zero

    def braking(t: Any) -> Any:
        return braked(t) / 10

    for a, b in spans(motion):
        # The brake slips wherever wheel 1 turns, the interface wherever the wheels differ; between kinks the
        # integrands are cubic at most, so quadrature is exact.
        if motion.velocity((a + b) / 2)[0] > 0:
            momentum += mp.quad(braking, [a, b])
            energy += mp.quad(lambda t: braking(t) * motion.velocity(t)[0], [a, b])
        else:  # a standing wheel passes the force of the interface on to the ground
            momentum += 10 * (b - a)
        energy += mp.quad(lambda t: 10 * (motion.velocity(t)[1] - motion.velocity(t)[0]), [a, b])
    start, end = motion.velocity(0), motion.velocity(4)
    lost = [sum(m * (u**n - v**n) for m, u, v in zip((1, 10), start, end, strict=True)) for n in (1, 2)]
    assert near(lost[0], momentum, 25)
    assert near(lost[1] / 2, energy, 25)


def test_precision_is_what_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = analytic.two_flywheels()
    monkeypatch.setattr(mp, "dps", 60)
    finer = analytic.two_flywheels()
    assert all(near(a.time, b.time, 35) for a, b in zip(coarse.events, finer.events, strict=True))
    assert all(near(a, b, 35) for a, b in zip(coarse.velocity(4), finer.velocity(4), strict=True))


# One or two bodies


@pytest.mark.parametrize(
    ("case", "force", "acceleration"),
    [
        ((-30, 0, 1, 10), Fraction(-300, 11), Fraction(-30, 11)),
        ((5, -3, 2, 6), Fraction(36, 8), Fraction(2, 8)),
        ((7, 3, 2, float("inf")), 7, 0),
        ((7, 3, float("inf"), 2), -3, 0),
    ],
)
def test_stick_phase(case: tuple[float, ...], force: Fraction, acceleration: Fraction) -> None:
    answer = analytic.stick_phase(*case)
    assert near(answer.force, force) and near(answer.acceleration, acceleration)


def test_stick_phase_tends_to_its_limit() -> None:
    answer = analytic.stick_phase(7, 3, 2, "1e30")
    assert near(answer.force, 7, 28) and near(answer.acceleration, 0, 28)


def test_lock_up() -> None:
    answer = analytic.lock_up(1, 10, -0.01, 10)
    assert near(answer.time, Fraction(1, 1100)) and near(answer.heat, Fraction(1, 22000))
    assert near(answer.time, analytic.two_flywheels().events[0].time)


def test_viscous_relaxation() -> None:
    # c (1/m1 + 1/m2) = 3 * (1 + 1/2) = 4.5
    assert near(analytic.viscous_relaxation(1, 2, 2, 3, 2), 2 * mp.exp(-9))
    assert near(analytic.viscous_relaxation(1, 2, 2, 3, 0), 2)


def test_pulled_block_obeys_newton() -> None:
    block = analytic.pulled_block(2, 8, 0.3, normal=10, mu_static=0.5, mu_coulomb=0.2)
    for start in (event.time for event in block.events(30) if event.after == 1):
        for n in range(1, 10):
            t = start + block.slip_time * n / 10
            x, v = block.state(t)
            assert near(mp.diff(lambda s: block.state(s)[0], t), v, 15)
            acceleration = mp.diff(lambda s: block.state(s)[1], t)
            assert near(2 * acceleration, 8 * (exact(0.3) * t - x) - 2, 15) and v > 0
    assert near(8 * (exact(0.3) * block.first_break - 0), 5)  # breaks at mu_s N


@pytest.mark.parametrize(
    ("case", "positions"),
    [
        ((1, 4, 1, 1.8), ("1.8", "-1.3", "0.8", "-0.3", "-0.2")),
        ((1, 4, 1, -1.8), ("-1.8", "1.3", "-0.8", "0.3", "0.2")),
        ((1, 1, 0.5, 1.5), ("1.5", "-0.5")),  # ends exactly on the level: it stays
        ((1, 4, 1, 1.8, 4), ("1.8", "-1.3", "0.8")),  # sticks better than it slips
        ((1, 4, 1, 0.2), ("0.2",)),  # never starts
    ],
)
def test_coulomb_decay(case: tuple[float, ...], positions: tuple[str, ...]) -> None:
    decay = analytic.coulomb_decay(*case)
    assert len(decay.turns) == len(positions)
    for n, ((t, x), expected) in enumerate(zip(decay.turns, positions, strict=True)):
        assert near(x, expected) and near(t, n * mp.pi / mp.sqrt(exact(case[1])))
        assert near(decay.state(t)[0], x) and near(decay.state(t)[1], 0)
    assert decay.state(100) == (decay.turns[-1][1], 0)
    for (t, x), (_, y) in pairwise(decay.turns):
        middle = t + mp.pi / mp.sqrt(exact(case[1])) / 3
        position, velocity = decay.state(middle)
        heat = exact(case[2]) * abs(x - position)
        assert near(exact(case[1]) * (x**2 - position**2) / 2, heat + velocity**2 / 2)
        assert mp.sign(velocity) == mp.sign(y - x)


# Den Hartog


@pytest.mark.parametrize(
    ("beta", "r", "amplitude"),
    [(0.8, 0.5, "2.332234987541365"), (2, 0.15, "0.3247862544984179"), (1.25, 0.4, "1.4800496969252543")],
)
def test_den_hartog(beta: float, r: float, amplitude: str) -> None:
    motion = analytic.den_hartog(beta, r)
    assert near(motion.amplitude, amplitude, 15)
    assert near(motion.state(0)[0], motion.amplitude) and motion.state(0)[1] == 0
    half = mp.pi / exact(beta)
    for n in range(1, 20):
        t = half * n / 20
        x, v = motion.state(t)
        assert v < 0
        assert near(mp.diff(lambda s: motion.state(s)[0], t), v, 15)
        force = mp.cos(exact(beta) * t + motion.phase) + exact(r) - x
        assert near(mp.diff(lambda s: motion.state(s)[1], t), force, 15)
        assert all(near(a, -b) for a, b in zip(motion.state(t + half), (x, v), strict=True))
    # At the turn, holding the mass would take more than the friction there is.
    assert near(abs(mp.cos(motion.phase) - motion.amplitude), exact(beta) ** 2 * motion.amplitude)
    # In each half period force and friction work equally: int P cos(omega t + phase) v dt = 2 F x0.
    work = mp.quad(
        lambda t: mp.cos(exact(beta) * t + motion.phase) * motion.state(t)[1],
        [0, half / 2, half * (1 - mp.eps)],
    )
    assert near(work, 2 * exact(r) * motion.amplitude, 25)


# The oracle itself


def test_floats_mean_their_decimals() -> None:
    assert exact(1.01) == exact("1.01") == exact(Fraction(101, 100)) == mp.mpf(101) / 100


def test_oracle_is_independent() -> None:
    tree = ast.parse(Path(analytic.__file__).read_text())
    names = {
        name.split(".")[0]
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert "mpmath" in names
    assert not names & {"stickslip", "numpy", "scipy", "sksundae"}
