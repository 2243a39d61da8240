"""Rows over random scenes: properties that every scene must have, whatever its motion is."""

from __future__ import annotations

import json
import math
import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

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
)
from validation.conservation import LAWS, Motion, move
from validation.rows import Array, Row, Tried, Wrong, asked, changes, require, story
from validation.tried import try_each

random_row = partial(Row, "Random scenes", tries="random scenes", same=True)
SEED = 20000
STOP = 0.7
GRID = np.linspace(0.0, STOP, 15)
OPTIONS: dict[str, Any] = {"rtol": 1e-8, "atol": 1e-10}
BOUND = 1e-5  # a thousand times rtol

# These tolerances over those of `validation.conservation`: the bounds of its laws are as many times wider here.
LOOSER = 100.0
PATIENCE = 60.0  # time in s after which a scene counts as hanging


def _is_swapped(name: str) -> bool:
    """Tell whether a contact has its ends swapped where a scene is renamed."""
    return int(name[1:]) % 2 == 0


class _Draw:
    """A scene drawn from a seed: the same one every time, or its mirror image, renamed, later in time, or heavier."""

    def __init__(
        self,
        number: int,
        mirror: bool = False,
        rename: bool = False,
        later: float = 0.0,
        factor: float = 1.0,
    ) -> None:
        self._random = np.random.default_rng([SEED, number])
        self._mirror, self._rename, self._later = -1.0 if mirror else 1.0, rename, later
        self._factor = factor

    def _one(self, *choices: Any) -> Any:
        return choices[int(self._random.integers(len(choices)))]

    def _number(self, low: float, high: float) -> float:
        return round(float(self._random.uniform(low, high)), 6)

    def _chance(self, probability: float) -> bool:
        return bool(self._random.random() < probability)

    def _load(self, size: float, sign: float, offset: float = 0.0) -> Signal | float:
        """Return a signal of any kind; `sign` mirrors it."""
        kind = self._one("constant", "sine", "linear", "linear", "jump")
        base = self._number(-size, size) if offset == 0 else offset
        if kind == "constant":
            return sign * base
        if kind == "sine":
            frequency, phase = self._number(0.2, 2.0), self._number(0.0, 6.0)
            turned = phase - 2 * math.pi * frequency * self._later
            return sine(sign * self._number(0.2, 0.9) * size, frequency, phase=turned, offset=sign * offset)
        times = np.cumsum(self._random.uniform(0.1, 0.8, 4))
        values = base + self._random.uniform(-size, size, 4)
        if kind == "jump":
            times, values = np.repeat(times, 2)[1:-1], np.repeat(values, 2)[:-2]
        return piecewise_linear((times + self._later).tolist(), (sign * values).tolist())

    def _law(self, swapped: bool) -> DryFriction:
        mu_c = self._number(0.05, 0.5)
        sides = [(round(mu_c * self._number(1.0, 2.0), 6), mu_c)] * 2
        if self._chance(0.2):
            back = self._number(0.05, 0.5)
            sides[1] = (round(back * self._number(1.0, 2.0), 6), back)
        dwell = self._number(0.01, 0.5) if self._chance(0.3) else 0.0
        stribeck = self._number(0.05, 1.0) if self._chance(0.2) else None
        if swapped:
            sides.reverse()
        (s, c), (s_back, c_back) = sides
        other: dict[str, Any] = (
            {} if sides[0] == sides[1] else {"mu_static_backward": s_back, "mu_coulomb_backward": c_back}
        )
        return DryFriction(s, c, dwell=dwell, stribeck_velocity=stribeck, **other)

    def scene(self) -> Scene:
        """Return the scene: 1 to 8 bodies in trees and loops, random laws, loads, springs and drives."""
        m, n = self._mirror, int(self._random.integers(1, 9))
        names = [f"b{i}" for i in range(n)]
        bodies: list[Any] = [
            Body(
                name,
                inertia=round(10 ** self._number(-1, 1), 6) * self._factor,
                velocity=m * self._number(-2, 2) if self._chance(0.7) else 0.0,
                position=m * self._number(-0.5, 0.5),
            )
            for name in names
        ]
        drives: list[Any] = []
        links: list[Any] = []
        contacts: list[Contact] = []
        fixed = [GROUND]
        if self._chance(0.4):
            velocity: Signal | float = m * self._number(-1, 1)
            if self._chance(0.5):
                frequency = 0.5 * self._one(1, 2)
                velocity = sine(m * self._number(0.2, 1.0), frequency, phase=-2 * math.pi * frequency * self._later)
            drives.append(Drive("drive", velocity=velocity))
            fixed.append("drive")
        for i, name in enumerate(names):
            other = self._one(*names[:i], *fixed)
            contacts.append(self._contact(len(contacts), name, other))
        for _ in range(int(self._random.integers(0, 3))):
            a, b = self._one(*names), self._one(*names, *fixed)
            if a != b:
                contacts.append(self._contact(len(contacts), a, b))
        for _ in range(int(self._random.integers(0, 3))):
            a, b = self._one(*names), self._one(*names, *fixed)
            stiffness, damping, rest = self._number(1, 50), self._number(0, 1), m * self._number(-0.2, 0.2)
            if a != b:
                links.append(
                    Spring(
                        a,
                        b,
                        stiffness=stiffness * self._factor,
                        damping=damping * self._factor,
                        rest=rest,
                    )
                )
        if self._chance(0.3):
            a, b, damping = self._one(*names), self._one(*names, *fixed), self._number(0.1, 2.0)
            if a != b:
                links.append(Damper(a, b, damping=damping * self._factor))
        loads = [
            Force(self._one(*names), self._load(10.0, m * self._factor))
            for _ in range(int(self._random.integers(0, 3)))
        ]
        if self._rename:
            bodies.reverse()
            contacts.reverse()
            links.reverse()
        return Scene(*bodies, *drives, *contacts, *links, *loads)

    def _contact(self, number: int, a: str, b: str) -> Contact:
        swap = self._rename and _is_swapped(f"c{number}")
        law = self._law(swapped=(self._mirror < 0) != swap)
        normal = self._load(8.0, self._factor, offset=self._number(3.0, 15.0))
        rested = self._number(0.0, 0.3) if self._chance(0.2) else 0.0
        a, b = (b, a) if swap else (a, b)
        return Contact(f"c{number}", a, b, law, normal=normal, rested=rested)


def draw(number: int, **how: Any) -> Scene:
    """Return random scene `number`, or a transformed one that must move the same way."""
    return _Draw(number, **how).scene()


@cache
def _moved(number: int) -> Motion:
    return move(draw(number), (0.0, STOP), parts=50, **OPTIONS)


@cache
def _plain(number: int) -> Result:
    return simulate(draw(number), (0.0, STOP), t_eval=GRID, **OPTIONS)


def _velocities(result: Result) -> Array:
    return np.array([result.velocity(f"b{i}") for i in range(len(result.scene.bodies))])


def _apart(number: int, other: Result, sign: int = 1, later: float = 0.0, swapped: bool = False) -> float:
    """Return the difference of velocities over the largest; other events of a contact are wrong."""
    first = _plain(number)
    for contact in first.scene.contacts:
        name = contact.name
        turn = -sign if swapped and _is_swapped(name) else sign
        wanted, found = ([e for e in changes(result) if e[1] == name] for result in (first, other))
        modes = [(turn * before, turn * after) for _, _, before, after in wanted]
        late = max((abs(a[0] + later - b[0]) for a, b in zip(wanted, found, strict=False)), default=0.0)
        same = modes == [e[2:] for e in found] and late <= BOUND
        require(same, f"{name} has {story(found)} where {story(wanted)} is expected, {later:g} s later")
    v = _velocities(first)
    return float(np.abs(sign * _velocities(other) - v).max()) / (float(np.abs(v).max()) or 1.0)


def _formulated(formulation: str, number: int) -> float:
    return _apart(number, simulate(draw(number), (0.0, STOP), **asked(formulation), t_eval=GRID, **OPTIONS))


def _changed(how: dict[str, Any], number: int) -> float:
    """Compare a changed scene that moves in the same way, or in the mirrored one."""
    later = how.get("later", 0.0)
    result = simulate(draw(number, **how), (later, later + STOP), t_eval=GRID + later, **OPTIONS)
    return _apart(number, result, -1 if "mirror" in how else 1, later, "rename" in how)


def _again(number: int) -> float:
    """Run the scene again as read from the file it was written to, and read the result back from pickle."""
    scene, first = draw(number), _plain(number)
    read = Scene.from_dict(json.loads(json.dumps(scene.to_dict())))
    if read != scene or pickle.loads(pickle.dumps(scene)) != scene:
        raise Wrong("the scene that was read is not the one that was written")
    errors = []
    for result in (simulate(read, (0.0, STOP), t_eval=GRID, **OPTIONS), pickle.loads(pickle.dumps(first))):
        if [str(e) for e in result.events] != [str(e) for e in first.events]:
            raise Wrong("other events")
        errors.append(float(np.abs(result.y - first.y).max()))
    return max(errors)


def over_scenes(measure: Callable[[int], float], count: int) -> Tried:
    """Return the worst of scenes 0 to count - 1; one that cannot be simulated is wrong."""
    tried = try_each(((f"scene {n}", partial(measure, n)) for n in range(count)), limit=PATIENCE)
    if tried.wrong or tried.hung:
        return tried
    events = sum(len(_plain(number).events) for number in range(count))
    return replace(tried, remark=f"{tried.remark}; {events} events")


def _of_motion(measure: Callable[[Motion], float], number: int) -> float:
    return measure(_moved(number))


_SAME: dict[str, tuple[Callable[[int], float], str]] = {
    "merged": (partial(_formulated, "merged"), "merged against contact-force"),
    "multiplier": (partial(_formulated, "multiplier"), "multiplier against contact-force"),
    "mirrored": (partial(_changed, {"mirror": True}), "the mirrored scene"),
    "renamed": (partial(_changed, {"rename": True}), "bodies and contacts in another order, ends swapped"),
    "later": (partial(_changed, {"later": 64.0}), "the same scene 64 s later"),
    "heavier": (partial(_changed, {"factor": 1024.0}), "inertias, stiffnesses and forces times 1024"),
    "again": (_again, "a second run, from JSON and pickle"),
}
CHECKS: dict[str, tuple[Callable[[int], float], str, str, float]] = {
    name: (partial(_of_motion, measure), what, source, LOOSER * bound)
    for name, (measure, what, source, bound) in LAWS.items()
} | {
    name: (measure, f"{what}: events, velocities", "the same motion", 0.0 if name == "again" else BOUND)
    for name, (measure, what) in _SAME.items()
}


def rows(count: int, multiplied: int | None = None) -> list[Row]:
    """Return the rows over `count` scenes, in the multiplier formulation, which is slow, over `multiplied` of them."""
    counts = dict.fromkeys(CHECKS, count) | {"multiplier": count if multiplied is None else multiplied}
    return [
        random_row(
            f"random-{name}",
            f"{counts[name]} random scenes: {what}",
            source,
            partial(over_scenes, measure, counts[name]),
            bound,
            limit=60.0 + 5.0 * count,
        )
        for name, (measure, what, source, bound) in CHECKS.items()
    ]
