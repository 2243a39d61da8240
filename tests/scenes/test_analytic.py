"""The oracle, against hand calculation, against itself by another way, and against the laws it must obey."""

import ast
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from validation import analytic
from validation.analytic import Contact, Motion, exact, mp

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


def parts(scene: dict[str, Any]) -> tuple[list[float], list[float], list[Contact]]:
    """Inertias, speeds and contacts of a scene as `chain` wants them: the brake first."""
    contacts = [
        Contact(c["name"], c["mu_s"], c["mu_c"], c["tau"], c["normal"])
        for c in sorted(scene["contacts"], key=lambda c: c["name"] != "brake")
    ]
    bodies = scene["bodies"]
    return [body["inertia"] for body in bodies], [body["velocity"] for body in bodies], contacts


def stepped(scene: dict[str, Any]) -> Motion:
    return analytic.chain(*parts(scene), until=scene["t_end"])


# The benchmark


@pytest.mark.parametrize(
    ("event", "expected"), [*zip(analytic.two_flywheels().events, BENCHMARK, strict=True)]
)
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


SHORT = (0.05, 0.06, 0.07)  # a first triangle that any interface holds
VARIANTS: list[dict[str, Any]] = [
    {},
    {"dwell": 0},
    {"dwell": 0.2},
    {"mu_static": 0.1, "triangles": (SHORT, (0.4, 0.5, 0.6))},
    {"inertias": (1, 20), "speeds": (1, 1.02)},
    {"inertias": (0.8, 12), "speeds": (0.9, 1), "mu_static": 0.19, "normal": 95},
    {"triangles": ((0.05, 0.09, 0.15), (0.4, 0.49, 0.62))},
    {"inertias": (Fraction(100), 1000), "normal": "10000", "slope": 300000},  # the scale is free
]


@pytest.mark.parametrize("changes", VARIANTS, ids=str)
def test_closed_form_equals_event_stepping(changes: dict[str, Any]) -> None:
    try:
        closed = analytic.two_flywheels(**changes)
    except ValueError as error:
        pytest.fail(f"a variant outside the story shows nothing: {error}")
    triangles = changes.get("triangles", ((0.05, 0.10, 0.15), (0.4, 0.5, 0.6)))
    slope = exact(changes.get("slope", 3000))
    brake = [
        (time, slope * (exact(peak) - exact(start)) * (time == peak))
        for start, peak, stop in triangles
        for time in (start, peak, stop)
    ]
    law = [
        changes.get(key, default)
        for key, default in (("mu_static", 0.2), ("mu_coulomb", 0.1), ("dwell", 0.1))
    ]
    contacts = [Contact("brake", *law, brake), Contact("interface", *law, changes.get("normal", 100))]
    other = analytic.chain(
        changes.get("inertias", (1, 10)), changes.get("speeds", (1, 1.01)), contacts, until=4
    )
    assert [event[1:] for event in closed.events] == [event[1:] for event in other.events]
    assert all(near(a.time, b.time) for a, b in zip(closed.events, other.events, strict=True))
    for n in range(401):
        t = Fraction(n, 400)
        assert all(near(a, b) for a, b in zip(closed.velocity(t), other.velocity(t), strict=True))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"speeds": (1, 1)}, "wheel 2 must start faster"),
        ({"speeds": (1, 2)}, "lock before the first triangle"),
        ({"slope": 4500}, "must hold through the first triangle"),
        ({"slope": 1000}, "must break while the second triangle rises"),
        ({"speeds": (0.1, 0.11)}, "both wheels must still turn"),
        ({"inertias": (10, 100), "speeds": (2, 2.001)}, "wheel 1 must stop"),
        (
            {"inertias": (0.5, 1), "speeds": (5, 5.001), "slope": 5000, "triangles": (SHORT, (0.4, 0.5, 1))},
            "wheel 2 must still turn",
        ),
        (
            {"inertias": (0.5, 3), "speeds": (3, 3.001), "slope": 6000, "triangles": (SHORT, (0.4, 0.45, 1))},
            "the brake must be off",
        ),
        ({"triangles": ((0.05, 0.10, 0.5), (0.4, 0.5, 0.6))}, "must come after the first"),
    ],
)
def test_other_stories_are_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        analytic.two_flywheels(**changes)


# Reference answers


@pytest.mark.parametrize(
    ("name", "motion"),
    [
        ("flywheels-2", analytic.two_flywheels()),
        ("flywheels-2", stepped(reference("flywheels-2")["scene"])),
        ("flywheels-4", analytic.four_flywheels()),
        ("flywheels-4", stepped(reference("flywheels-4")["scene"])),
    ],
)
def test_reference_flywheels(name: str, motion: Motion) -> None:
    answer = reference(name)["answer"]
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


# What every motion must obey


def normal(contact: Contact, t: Any) -> Any:
    if not isinstance(contact.normal, list | tuple):
        return exact(contact.normal)
    points = [(exact(time), exact(force)) for time, force in contact.normal]
    for (t0, f0), (t1, f1) in pairwise(points):
        if t0 <= t < t1:
            return f0 + (f1 - f0) * (t - t0) / (t1 - t0)
    return points[0][1] if t < points[0][0] else points[-1][1]


def spans(contacts: Sequence[Contact], motion: Motion, until: float) -> Iterator[tuple[Any, Any]]:
    """The times between which the motion has no kink."""
    marks = {mp.zero, exact(until), *(event.time for event in motion.events)}
    for contact in contacts:
        if isinstance(contact.normal, list | tuple):
            marks |= {exact(time) for time, _ in contact.normal if time < until}
    return pairwise(sorted(marks))


def assert_obeys(inertias: Sequence[Any], contacts: Sequence[Contact], motion: Motion, until: float) -> None:
    """Newton's law gives the contact forces, from the free end inwards; the friction law must allow them."""
    mode: dict[str, int] = {}
    since = dict.fromkeys([contact.name for contact in contacts], mp.zero)
    events = list(motion.events)
    for a, b in spans(contacts, motion, until):
        while events and events[0].time <= a:
            event = events.pop(0)
            assert mode[event.contact] == event.before
            mode[event.contact], since[event.contact] = event.after, event.time
        for t in (a + (b - a) / 100, (a + b) / 2, b - (b - a) / 100):
            h = (b - a) / 200
            v, ahead, behind = motion.velocity(t), motion.velocity(t + h), motion.velocity(t - h)
            push = mp.zero
            for k in reversed(range(len(inertias))):
                contact, sign = contacts[k], -1 if k == 0 else 1
                # The central difference of a quadratic is its derivative.
                push += exact(inertias[k]) * (ahead[k] - behind[k]) / (2 * h)
                r, w = sign * push, sign * ((v[k - 1] if k else 0) - v[k])
                seen = int(mp.sign(w)) if abs(w) > 1e-25 else 0
                assert mode.setdefault(contact.name, seen) == seen
                mu_s, mu_c, dwell = map(exact, (contact.mu_static, contact.mu_coulomb, contact.dwell))
                if seen:
                    assert abs(r - seen * mu_c * normal(contact, t)) < 1e-12
                else:
                    risen = 1 - mp.exp(-(t - since[contact.name]) / dwell) if dwell else 1
                    assert abs(r) <= (mu_c + (mu_s - mu_c) * risen) * normal(contact, t) + exact(1e-12)
    assert not events


def test_benchmark_obeys_the_laws() -> None:
    scene = reference("flywheels-2")["scene"]
    inertias, _, contacts = parts(scene)
    assert_obeys(inertias, contacts, analytic.two_flywheels(), 4)


def test_four_flywheels_obey_the_laws() -> None:
    scene = reference("flywheels-4")["scene"]
    inertias, _, contacts = parts(scene)
    assert_obeys(inertias, contacts, analytic.four_flywheels(), 4)


def tenths(low: int, high: int) -> st.SearchStrategy[Fraction]:
    return st.integers(low, high).map(lambda n: Fraction(n, 10))


@st.composite
def chains(draw: st.DrawFn) -> tuple[list[Fraction], list[Fraction], list[Contact]]:
    size = draw(st.integers(1, 4))
    contacts = []
    for k in range(size):
        mu_c, more = draw(tenths(1, 5)), draw(tenths(0, 5))
        points = [(Fraction(n, 2), draw(tenths(0, 90))) for n in range(4)]
        contacts.append(Contact(f"c{k}", mu_c + more, mu_c, draw(tenths(0, 5)), points))
    return [draw(tenths(1, 50)) for _ in range(size)], [draw(tenths(-20, 20)) for _ in range(size)], contacts


@pytest.mark.slow
@settings(max_examples=60, deadline=None, derandomize=True)
@given(chains())
def test_any_chain_obeys_the_laws(case: tuple[list[Fraction], list[Fraction], list[Contact]]) -> None:
    inertias, speeds, contacts = case
    motion = analytic.chain(inertias, speeds, contacts, until=2)
    assert_obeys(inertias, contacts, motion, 2)
    mirrored = analytic.chain(inertias, [-v for v in speeds], contacts, until=2)
    for event, image in zip(motion.events, mirrored.events, strict=True):
        assert near(event.time, image.time)
        assert event[1:] == (image.contact, -image.before, -image.after)


def test_benchmark_keeps_momentum_and_energy() -> None:
    """What momentum and energy are lost, the brake has taken and the contacts have turned to heat."""
    inertias, speeds, (brake, interface) = parts(reference("flywheels-2")["scene"])
    motion = analytic.two_flywheels()
    momentum = energy = mp.zero

    def braking(t: Any) -> Any:
        return exact(brake.mu_coulomb) * normal(brake, t)

    for a, b in spans([brake, interface], motion, 4):
        # The brake slips wherever wheel 1 turns, the interface wherever the wheels differ; between kinks the
        # integrands are cubic at most, so quadrature is exact.
        if motion.velocity((a + b) / 2)[0] > 0:
            momentum += mp.quad(braking, [a, b])
            energy += mp.quad(lambda t: braking(t) * motion.velocity(t)[0], [a, b])
        else:  # a standing wheel passes the force of the interface on to the ground
            momentum += 10 * (b - a)
        energy += mp.quad(lambda t: 10 * (motion.velocity(t)[1] - motion.velocity(t)[0]), [a, b])
    start, end = [exact(v) for v in speeds], motion.velocity(4)
    lost = [sum(m * (u**n - v**n) for m, u, v in zip(inertias, start, end, strict=True)) for n in (1, 2)]
    assert near(lost[0], momentum, 25)
    assert near(lost[1] / 2, energy, 25)


def test_precision_is_what_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse = [analytic.two_flywheels(), analytic.four_flywheels()]
    monkeypatch.setattr(mp, "dps", 60)
    for motion, finer in zip(coarse, [analytic.two_flywheels(), analytic.four_flywheels()], strict=True):
        assert all(near(a.time, b.time, 35) for a, b in zip(motion.events, finer.events, strict=True))
        assert all(near(a, b, 35) for a, b in zip(motion.velocity(4), finer.velocity(4), strict=True))


def test_chain_refuses_what_it_cannot_mean() -> None:
    brake = Contact("brake", 0.2, 0.1, 0, 10)
    with pytest.raises(ValueError, match="as many speeds"):
        analytic.chain([1, 2], [1, 2], [brake], until=1)
    with pytest.raises(ValueError, match="must not be negative"):
        analytic.chain([1], [1], [Contact("brake", 0.2, 0.1, 0, [(0, 1), (1, -1)])], until=1)
    with pytest.raises(ValueError, match="known from 0 to 1"):
        analytic.chain([1], [1], [brake], until=1).velocity(2)


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
    with pytest.raises(ValueError, match="infinite inertia"):
        analytic.stick_phase(1, 1, float("inf"), float("inf"))


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
    with pytest.raises(ValueError, match="above mu_coulomb"):
        analytic.pulled_block(1, 1, 1, normal=1, mu_static=0.2, mu_coulomb=0.2)


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


def test_den_hartog_in_units() -> None:
    motion = analytic.den_hartog(8, 20, mass=0.5, stiffness=50, force=40)  # beta = 0.8, r = 0.5
    assert near(motion.amplitude, mp.mpf("2.332234987541365") * 40 / 50, 15)
    assert near(mp.diff(lambda t: motion.state(t)[0], mp.mpf("0.1")), motion.state(0.1)[1], 15)


@pytest.mark.parametrize("beta", [0.28, 0.35, 0.45, 0.5, 0.8, 0.99, 1.5, 4])
def test_den_hartog_limit_is_where_the_motion_reverses(beta: float) -> None:
    """Inside, the mass never stops between its turns; with an amplitude less than at the limit it would."""
    limit = analytic.den_hartog_limit(beta)
    inside, at_limit = analytic.den_hartog(beta, 0.999 * limit), analytic.den_hartog(beta, limit)
    smaller = replace(at_limit, amplitude=0.99 * at_limit.amplitude)
    times = [mp.pi / exact(beta) * n / 500 for n in range(1, 500)]
    assert all(inside.state(t)[1] < 0 for t in times)
    assert any(smaller.state(t)[1] > 0 for t in times)
    with pytest.raises(ValueError, match="stops"):
        analytic.den_hartog(beta, 1.001 * limit)


def test_den_hartog_limit_known_values() -> None:
    assert near(analytic.den_hartog_limit(100000), 1 / mp.sqrt(1 + mp.pi**2 / 4), 9)  # fast excitation
    # At beta = 1/2, U = 0 and V = 4/3, and S = 1: F/P = beta² V.
    assert near(analytic.den_hartog_limit(0.5), Fraction(1, 3))
    with pytest.raises(ValueError, match="neither 1"):
        analytic.den_hartog(1, 0.1)


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
