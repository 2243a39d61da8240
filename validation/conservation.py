"""Rows on laws that no motion may violate: momentum, energy, heat, and the limit of friction.

Everything is summed up here from velocities, positions and forces at given times; `EnergyLedger` is not used.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from validation.exact import INTEGRATED, REFERENCES, TIGHT, reference
from validation.published import belt, coupled_clutches
from validation.rows import FORMULATIONS, Answer, Array, Row, asked, require

conservation_row = partial(Row, "Conservation")
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True)
class Motion:
    """A simulated motion at edges in time, `is_edge`, and at five Gauss points between neighbouring edges."""

    scene: Scene
    start: float
    at: Result
    is_edge: NDArray[np.bool_]

    def edges(self, values: Array) -> Array:
        """Return values at the edges."""
        return values[self.is_edge]

    def integral(self, rate: Array) -> Array:
        """Return the integral of a rate from the first edge to each."""
        nodes = rate[~self.is_edge].reshape(-1, _NODES.size)
        return np.concatenate([[0.0], np.cumsum(nodes @ _WEIGHTS * 0.5 * np.diff(self.edges(self.at.t)))])


def move(
    scene: Scene,
    span: tuple[float, float],
    formulation: str = "contact-force",
    parts: int = 200,
    **options: Any,
) -> Motion:
    """Simulate a scene, and again with outputs at Gauss points between its computed points."""
    options = TIGHT | options | asked(formulation)
    whole = simulate(scene, span, **options)
    edges = np.union1d(whole.t, np.linspace(*span, parts + 1))
    edges = np.concatenate([edges[:-1][np.diff(edges) > 1e-12 * (span[1] - span[0])], edges[-1:]])
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    nodes = middle[:, None] + half[:, None] * _NODES
    t = np.append(np.column_stack([edges[:-1], nodes]).ravel(), edges[-1])
    is_edge = np.arange(t.size) % (_NODES.size + 1) == 0
    at = simulate(scene, span, t_eval=t, **options)
    require([str(e) for e in at.events] == [str(e) for e in whole.events], "outputs change the events")
    return Motion(scene, span[0], at, is_edge)


# Forces and powers, written out


def _velocity(result: Result, name: str) -> Array:
    return np.zeros_like(result.t) if name == GROUND else result.velocity(name)


def _sampled(load: Signal | float, t: Array) -> Array:
    return load.sampled(t) if isinstance(load, Signal) else np.full(t.size, float(load))


def _stretch(result: Result, spring: Spring) -> Array:
    """Return the stretch of a spring."""
    x = [np.zeros_like(result.t) if end == GROUND else result.position(end) for end in (spring.a, spring.b)]
    return x[0] - x[1] - spring.rest


def _forces(result: Result) -> list[tuple[str, Array]]:
    """Return every force, with the name of the body it acts on: of contacts, springs, dampers, loads."""
    found = []
    for c in result.scene.contacts:
        r = result.force(c.name)
        found += [(c.a, -r), (c.b, r)]
    for s in result.scene.springs:
        w = _velocity(result, s.a) - _velocity(result, s.b)
        pull = s.damping * w + (s.stiffness * _stretch(result, s) if s.stiffness else 0.0)
        found += [(s.a, -pull), (s.b, pull)]
    for d in result.scene.dampers:
        w = _velocity(result, d.a) - _velocity(result, d.b)
        found += [(d.a, -d.damping * w), (d.b, d.damping * w)]
    found += [(f.body, _sampled(f.signal, result.t)) for f in result.scene.forces]
    return found


def momentum_error(m: Motion) -> float:
    """Momentum that each body gains less the impulse on it, over the larger of all momentum and all impulses."""
    zero = np.zeros_like(m.at.t)
    momentum = {body.name: body.inertia * m.at.velocity(body.name) for body in m.scene.bodies}
    impulse = dict.fromkeys(momentum, zero)
    for name, force in _forces(m.at):
        if name in impulse:
            impulse[name] = impulse[name] + force
    gained = [m.edges(p - p[0]) - m.integral(impulse[name]) for name, p in momentum.items()]
    # the sizes of all forces on bodies, those between bodies too
    total = m.integral(sum((np.abs(f) for name, f in _forces(m.at) if name in momentum), zero))
    scale = max(float(np.max(sum(map(np.abs, momentum.values())))), float(total[-1])) or 1.0
    return float(np.abs(gained).max()) / scale


def energy_error(m: Motion) -> float:
    """Energy gained plus heat less work, over the largest of all of them."""
    scene, at = m.scene, m.at
    stored = sum(0.5 * body.inertia * at.velocity(body.name) ** 2 for body in scene.bodies)
    for s in scene.springs:
        if s.stiffness:
            stored = stored + 0.5 * s.stiffness * _stretch(at, s) ** 2
    stored = m.edges(stored)
    heat = np.zeros_like(at.t)
    for c in scene.contacts:
        heat = heat + at.force(c.name) * (_velocity(at, c.a) - _velocity(at, c.b))
    for link in (*scene.springs, *scene.dampers):
        heat = heat + link.damping * (_velocity(at, link.a) - _velocity(at, link.b)) ** 2
    drives = {drive.name for drive in scene.drives}
    work = sum((_sampled(f.signal, at.t) * at.velocity(f.body) for f in scene.forces), np.zeros_like(at.t))
    for name, force in _forces(at):
        if name in drives:
            work = work - force * at.velocity(name)
    lost, done = m.integral(heat), m.integral(work)
    scale = max(float(np.abs(x).max()) for x in (stored, lost, done)) or 1.0
    return float(np.abs(stored - stored[0] + lost - done).max()) / scale


def power_error(m: Motion) -> float:
    """The most negative friction power, over the largest."""
    power = [m.at.power(c.name) for c in m.scene.contacts]
    largest = max((float(np.abs(p).max()) for p in power), default=0.0) or 1.0
    return max((max(-float(p.min()), 0.0) for p in power), default=0.0) / largest


def _slipping(law: DryFriction, side: int, w: Array) -> Array:
    """Return the coefficient of friction at relative velocities."""
    static, coulomb = law.mu_s(side), law.mu_c(side)
    if law.kinetic is not None:
        return np.array([law.kinetic(x) for x in np.abs(w).tolist()])
    if law.stribeck_velocity is None:
        return np.full(w.size, coulomb)
    fall = np.exp(-((np.abs(w) / law.stribeck_velocity) ** law.stribeck_exponent))
    return np.asarray(coulomb + (static - coulomb) * fall)


def law_error(m: Motion) -> float:
    """How far friction is off its law, over the largest limit: eq. (9) where it sticks, mu_k N where it slips."""
    found = 0.0
    for c in m.scene.contacts:
        law = c.law
        assert isinstance(law, DryFriction)
        t, r, mode, w = m.at.t, m.at.force(c.name), m.at.mode(c.name), m.at.relative_velocity(c.name)
        normal = np.maximum(_sampled(c.normal, t), 0.0)
        since = np.full(t.size, m.start - c.rested)
        for e in m.at.events:
            if e.contact == c.name and int(e.after) == 0:
                since[t >= e.t] = e.t
        off = largest = 0.0
        for side in (1, -1):
            static, kinetic = law.mu_s(side), law.mu_k(0.0, side)
            # the level rises from the kinetic friction that the contact has as it comes to rest
            risen = static - (static - kinetic) * np.exp(-(t - since) / law.dwell) if law.dwell else static
            beyond = (side * r - risen * normal)[mode == 0]
            wrong = (r - side * _slipping(law, side, w) * normal)[mode == side]
            off = max(off, float(beyond.max(initial=0.0)), float(np.abs(wrong).max(initial=0.0)))
            largest = max(largest, float((static * normal).max()))
        found = max(found, off / (largest or 1.0))
    return found


def stuck_error(m: Motion) -> float:
    """Relative velocity of stuck contacts: exactly 0."""
    found = 0.0
    for c in m.scene.contacts:
        stuck = (m.at.mode(c.name) == 0) & (np.maximum(_sampled(c.normal, m.at.t), 0.0) > 0)
        found = max(found, float(np.abs(m.at.relative_velocity(c.name)[stuck]).max(initial=0.0)))
    return found


# Cases


def _mixed() -> Scene:
    """Everything at once: loops, a sine belt, dwell, Stribeck, anisotropy, springs, dampers, a varying normal force."""
    return Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=2.5, position=0.2),
        Body("c", inertia=0.4, velocity=-0.5),
        Drive("belt", velocity=sine(0.8, 0.7)),
        Contact("ab", "a", "b", DryFriction(0.5, 0.3, dwell=0.1), normal=8.0),
        Contact("bc", "b", "c", DryFriction(0.6, 0.3, stribeck_velocity=0.2), normal=sine(4.0, 0.9, offset=5.0)),
        Contact("ca", "c", "a", DryFriction(0.4, 0.4), normal=3.0),
        Contact(
            "rub",
            "b",
            "belt",
            DryFriction(0.5, 0.4, mu_static_backward=0.3, mu_coulomb_backward=0.2),
            normal=piecewise_linear([0.0, 1.0, 2.0, 3.0], [6.0, 12.0, 0.0, 9.0]),
        ),
        Spring("a", GROUND, stiffness=7.0, damping=0.1),
        Damper("b", "c", damping=0.2),
        Force("c", sine(2.0, 1.3)),
    )


def _free_star() -> Scene:
    """Bodies that touch only each other."""
    law = DryFriction(0.3, 0.2, dwell=0.05)
    return Scene(
        *(Body(f"b{i}", inertia=1.0 + i, velocity=np.sin(3.0 * i + 1)) for i in range(5)),
        *(Contact(f"c{i}", "b0", f"b{i}", law, normal=2.0 + i) for i in range(1, 5)),
        Contact("loop", "b1", "b2", law, normal=2.0),
        Spring("b3", "b4", stiffness=3.0),
    )


def _scene_of(name: str) -> Scene:
    return reference(name).scene


CASES: dict[str, tuple[Callable[[], Scene], float]] = {
    **{name: (partial(_scene_of, name), reference(name).stop) for name in REFERENCES},
    "coupled-clutches": (coupled_clutches, 1.5),
    "leine-belt": (belt, 25.0),
    "mixed": (_mixed, 4.0),
    "free-star": (_free_star, 3.0),
}


@cache
def _moved(name: str, formulation: str) -> Motion:
    scene, stop = CASES[name]
    return move(scene(), (0.0, stop), formulation)


def over_all(measure: Callable[[Motion], float], formulation: str) -> Answer:
    """Return the worst of all cases."""
    errors = {name: measure(_moved(name, formulation)) for name in CASES}
    name = max(errors, key=errors.__getitem__)
    return errors[name], f"{len(errors)} cases, worst: {name}"


# The measure, its description, the source of the right answer, and the largest error at tight tolerances.
LAWS: dict[str, tuple[Callable[[Motion], float], str, str, float]] = {
    "momentum": (
        momentum_error,
        "momentum that each body gains less the impulse on it, over all",
        "sum of m v' = sum of F",
        1e-8,
    ),
    "energy": (
        energy_error,
        "kinetic and spring energy gained, plus heat, less work; over the largest",
        "first law",
        INTEGRATED,
    ),
    "friction-power": (
        power_error,
        "friction never drives: most negative power over the largest",
        "r w >= 0",
        1e-9,
    ),
    "friction-law": (
        law_error,
        "friction beyond its limit where it sticks, off mu_k N where it slips; over the largest limit",
        "|r| <= B, eqs. (8)-(9); r = sign(w) mu_k N",
        INTEGRATED,
    ),
    "stuck": (stuck_error, "relative velocity of stuck contacts", "0, exactly", 0.0),
}

ROWS = [
    conservation_row(
        f"{name}/{f}",
        f"{what}; over all cases ({f})",
        source,
        partial(over_all, measure, f),
        bound,
        quick=f != "multiplier",
        limit=120.0,
    )
    for f in FORMULATIONS
    for name, (measure, what, source, bound) in LAWS.items()
]
