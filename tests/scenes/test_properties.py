"""What every motion must obey, on random scenes: trees and loops of one to eight bodies, loads, springs, drives."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, note, settings
from hypothesis import strategies as st

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Result,
    Scene,
    Signal,
    Spring,
    piecewise_linear,
    simulate,
    sine,
    triangle,
)

STOP = 2.0
SCENES = settings(
    max_examples=50,
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
    database=None,
)
FEWER = settings(SCENES, max_examples=16)
seeds = st.integers(0, 10**9)


@dataclass(frozen=True)
class Change:
    """How a scene is changed into one whose motion is known from the first."""

    shift: float = 0.0
    sign: float = 1.0
    factor: float = 1.0
    shuffle: bool = False


class Maker:
    """Draws the same scene for the same seed, changed or not."""

    def __init__(self, seed: int, change: Change) -> None:
        self._random, self._change = random.Random(seed), change

    def number(self, low: float, high: float) -> float:
        return round(self._random.uniform(low, high), 4)

    def _points(self, low: float, high: float) -> tuple[list[float], list[float]]:
        times = sorted({0.0, *(self.number(0, STOP) for _ in range(self._random.randint(2, 5)))})
        values = [self.number(low, high) for _ in times]
        if self._random.random() < 0.3:
            jump = self._random.randrange(len(times))
            times.insert(jump, times[jump])
            values.insert(jump, self.number(low, high))
        return [t + self._change.shift for t in times], values

    def _oscillation(self, offset: float) -> Signal:
        frequency, phase = self.number(0.1, 0.8), self.number(0, 6)
        return sine(
            self.number(0.5, 5),
            frequency,
            phase - 2 * np.pi * frequency * self._change.shift,
            self.number(0, offset),
        )

    def signal(self, low: float, high: float, scale: float) -> Signal:
        kind = self._random.random()
        if kind < 0.25:
            return piecewise_linear([0.0], [self.number(low, high)]) * scale
        if kind < 0.8:
            return piecewise_linear(*self._points(low, high)) * scale
        return self._oscillation(high / 2) * scale

    def normal(self) -> Signal:
        scale = self._change.factor
        if self._random.random() < 0.5:
            return piecewise_linear([0.0], [self.number(1, 20)]) * scale
        if self._random.random() < 0.3:
            start = self.number(0, STOP - 1) + self._change.shift
            return triangle(start, start + 0.5, start + 1, slope=self.number(5, 40)) * scale
        return self.signal(-3, 20, scale)

    def law(self) -> DryFriction:
        coulomb = self.number(0, 0.5)
        static = coulomb + self._random.choice([0.0, 0.1, self.number(0, 0.4)])
        coefficients = [(static, coulomb)] * 2
        if self._random.random() < 0.15:
            coefficients[1] = (coulomb / 2 + 0.1, coulomb / 2)
        stribeck = self._random.choice([None] * 5 + [0.1, 0.5])
        dwell = self._random.choice([0.0, 0.0, 0.1, 1.0]) if stribeck is None else 0.0
        forward, backward = coefficients[:: int(self._change.sign)]
        return DryFriction(
            *forward,
            dwell=dwell,
            stribeck_velocity=stribeck,
            mu_static_backward=backward[0],
            mu_coulomb_backward=backward[1],
        )

    def scene(self, ground: bool = True, drives: bool = True, loads: bool = True) -> Scene:
        pick, change = self._random, self._change
        sign, factor = change.sign, change.factor
        count = pick.randint(1, 8)
        elements: list[Any] = []
        names = [f"b{i}" for i in range(count)]
        for name in names:
            elements.append(
                Body(
                    name,
                    inertia=self.number(0.5, 5) * factor,
                    velocity=pick.choice([0.0, self.number(-2, 2)]) * sign,
                    position=self.number(-1, 1) * sign,
                )
            )
        fixed = [GROUND] if ground and pick.random() < 0.7 else []
        if drives and pick.random() < 0.4:
            elements.append(Drive("belt", velocity=self.signal(-1, 1, sign)))
            fixed.append("belt")
        pairs = [(names[i], names[pick.randrange(i)]) for i in range(1, count) if pick.random() < 0.85]
        pairs += [(name, other) for name in names for other in fixed if pick.random() < 0.4]
        if count > 1:
            pairs += [tuple(pick.sample(names, 2)) for _ in range(pick.choice([0, 0, 1, 2]))]
        for number, (a, b) in enumerate(pairs):
            elements.append(Contact(f"c{number}", a, b, self.law(), normal=self.normal()))
        for _ in range(pick.choice([0, 0, 1, 2])):
            a, b = pick.sample([*names, *(fixed or ["b0", "b0"])], 2)
            if a != b and (a in names or b in names):
                stiffness, damping = (
                    self.number(0.5, 20) * factor,
                    pick.choice([0.0, self.number(0, 1)]) * factor,
                )
                elements.append(
                    Spring(a, b, stiffness=stiffness, damping=damping, rest=self.number(-1, 1) * sign)
                )
        if count > 1 and pick.random() < 0.3:
            elements.append(Damper(*pick.sample(names, 2), damping=self.number(0.1, 2) * factor))
        for _ in range(pick.randint(0, 3) if loads else 0):
            elements.append(Force(pick.choice(names), self.signal(-10, 10, sign * factor)))
        if change.shuffle:
            pick.shuffle(elements)
        return Scene(*elements)


def make(seed: int, change: Change = Change(), **parts: bool) -> Scene:
    return Maker(seed, change).scene(**parts)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)


def within_steps(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Computed steps, 150 at most: their numbers, and four times within each."""
    steps = np.flatnonzero(np.diff(result.t) > 1e-9)
    steps = steps[:: 1 + steps.size // 150]
    left, width = result.t[:-1][steps], np.diff(result.t)[steps]
    return steps, left[:, None] + 0.5 * width[:, None] * (NODES + 1)


def limits(scene: Scene, result: Result) -> tuple[float, float]:
    """The largest speed and the largest friction force of the motion: the scales of errors."""
    speeds = [np.abs(result.velocity(b.name)).max() for b in (*scene.bodies, *scene.drives)]
    forces = [np.abs(result.force(c.name)).max() for c in scene.contacts]
    return max(1e-3, *speeds), max([1e-3, *forces])


def kinetic(law: DryFriction, w: np.ndarray, mode: np.ndarray) -> np.ndarray:
    """The kinetic coefficients at relative velocities, 0 where the contact does not slip."""
    forward, backward = ((law.mu_static, law.mu_coulomb), (law.mu_static_backward, law.mu_coulomb_backward))
    static, coulomb = (np.where(mode < 0, *pair) for pair in zip(backward, forward, strict=True))
    if law.stribeck_velocity is not None:
        coulomb = coulomb + (static - coulomb) * np.exp(-((np.abs(w) / law.stribeck_velocity) ** 2))
    return np.where(mode == 0, 0.0, coulomb)


def check_laws(scene: Scene, result: Result) -> None:
    speed, force = limits(scene, result)
    for contact in scene.contacts:
        name = contact.name
        w, r, mode = result.relative_velocity(name), result.force(name), result.mode(name)
        normal = np.maximum(0.0, [contact.normal(t) for t in result.t])
        np.testing.assert_allclose(result.normal(name), normal, rtol=1e-9, atol=1e-9)
        stuck, slips = (mode == 0) & (normal > 0), (mode != 0) & (normal > 0)
        # stuck contacts do not move, and hold no more than they can
        assert np.all(np.abs(w[stuck]) <= 4e-16 * speed)
        assert np.all(np.abs(r[stuck]) <= result.breakaway(name)[stuck] + 1e-7 * force)
        # slipping ones resist with the kinetic force
        mu = kinetic(contact.law, w, mode)
        np.testing.assert_allclose(r[slips], (mode * mu * normal)[slips], rtol=0, atol=1e-7 * force)
        assert np.all((w * mode)[slips] >= -1e-7 * speed)
        np.testing.assert_allclose(r[normal == 0], 0.0, atol=1e-14 * force)
        # friction takes energy and never gives any
        assert np.all(result.power(name) >= -1e-7 * force * speed)


def check_events(result: Result) -> None:
    assert [e.t for e in result.events] == sorted(e.t for e in result.events)
    last: dict[str, Any] = {}
    for event in result.events:
        assert event.before != event.after
        assert last.get(event.contact, event.before) == event.before
        last[event.contact] = event.after
    for name, mode in last.items():
        if result.normal(name)[-1] > 0:
            assert result.mode(name)[-1] == mode


def check_momentum(scene: Scene, whole: Result, result: Result) -> None:
    """Newton's law over computed steps: momentum changes by the impulse of all reported forces."""
    steps, points = within_steps(whole)
    places, width = np.searchsorted(result.t, points), np.diff(whole.t)[steps]
    times = result.t
    speed, force = limits(scene, whole)
    total = {b.name: np.zeros(times.size) for b in (*scene.bodies, *scene.drives)}
    total[GROUND] = np.zeros(times.size)
    for link in (*scene.springs, *scene.dampers):
        pull = link.damping * (result.velocity(link.a) - result.velocity(link.b))
        if isinstance(link, Spring):
            pull = pull + link.stiffness * (result.position(link.a) - result.position(link.b) - link.rest)
        total[link.a] -= pull
        total[link.b] += pull
    for contact in scene.contacts:
        total[contact.a] -= result.force(contact.name)
        total[contact.b] += result.force(contact.name)
    for load in scene.forces:
        total[load.body] += [load.signal(t) for t in times]
    for body in scene.bodies:
        impulse = 0.5 * width * (total[body.name][places] @ WEIGHTS)
        gained = body.inertia * np.diff(whole.velocity(body.name))[steps]
        np.testing.assert_allclose(gained, impulse, rtol=0, atol=1e-6 * (body.inertia * speed + force))


@pytest.mark.slow
@SCENES
@given(seeds)
def test_a_scene_moves_as_its_laws_say(seed: int) -> None:
    scene = make(seed)
    whole = simulate(scene, (0.0, STOP))
    check_events(whole)
    _, points = within_steps(whole)
    some = whole.sample(np.union1d(points, np.unique(whole.t)[:: 1 + whole.t.size // 150]))
    check_momentum(scene, whole, some)
    check_laws(scene, some)


@pytest.mark.slow
@FEWER
@given(seeds)
def test_formulations_agree(seed: int) -> None:
    """What is integrated differs, the motion does not."""
    scene = make(seed)
    times = np.linspace(0.0, STOP, 31)
    options: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-11, "t_eval": times}
    first = simulate(scene, (0.0, STOP), **options)
    merged = simulate(scene, (0.0, STOP), formulation="merged", **options)
    assert told(first) == told(merged)
    speed, _ = limits(scene, first)
    for body in scene.bodies:
        v = first.velocity(body.name)
        np.testing.assert_allclose(merged.velocity(body.name), v, rtol=0, atol=1e-5 * speed)


def told(result: Result, sign: float = 1.0) -> list[tuple[float, str, float, float]]:
    """The events in an order that roundoff does not change; an open contact's modes mean little."""
    listed = [e for e in result.events if e.cause != "open"]
    rows: list[tuple[float, str, float, float]] = []
    start = -1.0
    for e in listed:
        start = e.t if e.t > start + 1e-6 else start
        rows.append((start, e.contact, sign * e.before, sign * e.after))
    return [(0.0, *row[1:]) for row in sorted(rows, key=lambda row: row[:2])]


@pytest.mark.slow
@FEWER
@given(seeds)
def test_momentum_is_kept_without_ground_drives_and_loads(seed: int) -> None:
    scene = make(seed, ground=False, drives=False, loads=False)
    result = simulate(scene, (0.0, STOP))
    momentum = sum(body.inertia * result.velocity(body.name) for body in scene.bodies)
    scale = sum(body.inertia * abs(body.velocity) for body in scene.bodies)
    assert np.ptp(momentum) <= 1e-7 * max(scale, 1.0)


def energy(scene: Scene, result: Result) -> np.ndarray:
    kinetic = sum(0.5 * body.inertia * result.velocity(body.name) ** 2 for body in scene.bodies)
    return kinetic + sum(
        0.5 * s.stiffness * (result.position(s.a) - result.position(s.b) - s.rest) ** 2 for s in scene.springs
    )


@pytest.mark.slow
@FEWER
@given(seeds)
def test_energy_only_falls_without_drives_and_loads(seed: int) -> None:
    scene = make(seed, drives=False, loads=False)
    result = simulate(scene, (0.0, STOP))
    stored = energy(scene, result)
    assert np.all(np.diff(stored) <= 1e-7 * max(1.0, stored[0]))


CHANGES: dict[str, tuple[Change, Callable[[Result, str], np.ndarray]]] = {
    "mirror image": (Change(sign=-1.0), lambda result, body: -result.velocity(body)),
    "other order": (Change(shuffle=True), lambda result, body: result.velocity(body)),
    "later": (Change(shift=3.0), lambda result, body: result.velocity(body)),
    "heavier": (Change(factor=1024.0), lambda result, body: result.velocity(body)),
}


@pytest.mark.slow
@FEWER
@example(10590793)  # three contacts at their levels at once, whose forces on one body point both ways
@given(seeds)
def test_changed_scenes_move_accordingly(seed: int) -> None:
    times = np.linspace(0.0, STOP, 101)
    # tight tolerances: what differs by roundoff may step differently
    options: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-12}
    scene = make(seed)
    first = simulate(scene, (0.0, STOP), t_eval=times, **options)
    speed, _ = limits(scene, first)
    for kind, (change, velocity) in CHANGES.items():
        note(kind)
        changed = simulate(
            make(seed, change), (change.shift, change.shift + STOP), t_eval=times + change.shift, **options
        )
        assert told(first, change.sign) == told(changed)
        ours, theirs = ([e.t for e in result.events if e.cause != "open"] for result in (first, changed))
        np.testing.assert_allclose(np.add(ours, change.shift), theirs, rtol=0, atol=1e-5)
        for body in scene.bodies:
            np.testing.assert_allclose(
                velocity(changed, body.name), first.velocity(body.name), rtol=0, atol=1e-5 * speed
            )


@pytest.mark.slow
@FEWER
@given(seeds)
def test_reruns_are_bit_identical(seed: int) -> None:
    scene = make(seed)
    first, second = simulate(scene, (0.0, STOP)), simulate(scene, (0.0, STOP))
    assert first.t.tobytes() == second.t.tobytes() and first.y.tobytes() == second.y.tobytes()
    assert first.events == second.events and first.stats == second.stats


@pytest.mark.slow
@FEWER
@given(seeds)
def test_an_unconnected_scene_changes_nothing(seed: int) -> None:
    scene = make(seed)
    other = (
        Body("unconnected", inertia=1.0, velocity=1.0),
        Spring("unconnected", GROUND, stiffness=100.0),
        Contact("beside", "unconnected", GROUND, DryFriction(0.3, 0.2), normal=10.0),
    )
    both = Scene(*scene.elements, *other)
    times = np.linspace(0.0, STOP, 31)
    alone, beside = (simulate(one, (0.0, STOP), t_eval=times) for one in (scene, both))
    others = [e for e in beside.events if e.contact != "beside"]
    assert [(e.contact, e.after) for e in others] == [(e.contact, e.after) for e in alone.events]
    # the series leaves roundoff; where a curve asks for CVODE, all parts share its steps
    exact = alone.stats["engine"] == "Taylor series"
    off = 1e-10 if exact else 1e-5
    np.testing.assert_allclose([e.t for e in others], [e.t for e in alone.events], rtol=0, atol=off * STOP)
    n = len(scene.bodies)
    speed = max(1.0, float(np.abs(alone.y[:n]).max()))
    np.testing.assert_allclose(beside.y[:n], alone.y[:n], rtol=0, atol=10 * off * speed)
