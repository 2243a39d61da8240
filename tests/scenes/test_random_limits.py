"""Random machines with gaps, stops, gears, clutches and contacts: properties of all of them; refused arguments."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    OneWay,
    Result,
    Scene,
    Spring,
    Stop,
    simulate,
    sine,
)

SEEDS = range(8)


def machine(seed: int, force: float = 1.0) -> Scene:
    """A row of bodies with play, stops and friction between them, a gear and a clutch, pushed by a sine."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 6))
    x = np.cumsum(rng.uniform(1.0, 2.0, n)).round(3)
    elements: list[Any] = [
        Body(
            f"b{k}",
            inertia=force * round(float(rng.uniform(0.3, 3)), 3),
            position=float(x[k]),
            velocity=round(float(rng.uniform(-1, 1)), 3),
        )
        for k in range(n)
    ]
    for k in range(n - 1):
        upper = float(x[k] - x[k + 1] + rng.uniform(0.1, 0.6))
        if rng.random() < 0.5:
            e = float(rng.choice([0.0, 0.4, 0.9, 1.0]))
            elements.append(Stop(f"s{k}", f"b{k}", f"b{k + 1}", upper=upper, lower=upper - 3, restitution=e))
        else:
            stiffness, damping = force * float(rng.choice([20, 200])), force * float(rng.choice([0, 2]))
            limits = {"upper": upper, "lower": upper - 3}
            elements.append(Gap(f"g{k}", f"b{k}", f"b{k + 1}", stiffness=stiffness, damping=damping, **limits))
        if rng.random() < 0.5:
            elements.append(Contact(f"c{k}", f"b{k}", f"b{k + 1}", DryFriction(0.5, 0.3), normal=force))
    end = float(x[-1]) + 0.5
    elements += [
        Stop("wall", f"b{n - 1}", GROUND, upper=end, lower=-5.0, restitution=0.5),
        Contact("floor", "b0", GROUND, DryFriction(0.4, 0.2), normal=force),
        Spring("b0", GROUND, stiffness=3 * force, rest=float(x[0])),
        Force("b0", sine(3.0 * force, frequency=0.6)),
        Body("wheel", inertia=0.5 * force, velocity=float(2 * elements[1].velocity)),
        Gear("gear", "wheel", "b1", ratio=2.0),
        Body("fly", inertia=0.4 * force, velocity=float(2 * elements[1].velocity)),
        OneWay("free", "wheel", "fly"),
    ]
    return Scene(*elements)


def run(scene: Scene, **options: Any) -> Result:
    return simulate(scene, (0, 4), t_eval=np.linspace(0, 4, 81), **options)


@pytest.mark.parametrize("seed", SEEDS)
def test_limits_hold_and_energy_is_never_created(seed: int) -> None:
    result = run(machine(seed))
    assert result.success
    ledger = result.energy()
    assert ledger.relative_error < 1e-11
    for heat in (*ledger.contacts.values(), *ledger.dampers.values(), *ledger.impacts.values()):
        assert np.diff(heat).min() > -1e-11
    for stop in result.scene.stops:
        stretch = result.stretch(stop.name)
        assert stretch.max() <= stop.upper + 1e-9
        assert stretch.min() >= stop.lower - 1e-9
        # a stop pushes only at a limit, and only back
        force = result.force(stop.name)
        at_upper, at_lower = stretch > stop.upper - 1e-9, stretch < stop.lower + 1e-9
        assert (force[at_upper] >= -1e-9).all()
        assert (force[at_lower] <= 1e-9).all()
        assert np.abs(force[~at_upper & ~at_lower]).max(initial=0.0) < 1e-12
    for gap in result.scene.gaps:
        stretch, force = result.stretch(gap.name), result.force(gap.name)
        assert np.abs(force[(stretch < gap.upper) & (stretch > gap.lower)]).max(initial=0.0) < 1e-9
        assert (force[stretch > gap.upper] >= -1e-9).all()
        assert (force[stretch < gap.lower] <= 1e-9).all()
    assert np.array_equal(result.velocity("wheel"), 2 * result.velocity("b1"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_units_and_order_do_not_matter(seed: int) -> None:
    plain = run(machine(seed))
    scaled = run(machine(seed, 2.0**20))
    mixed = list(machine(seed).elements)
    np.random.default_rng(seed).shuffle(mixed)  # type: ignore[arg-type]
    other = run(Scene(*mixed))

    def told(result: Result) -> list[tuple[float, str, int]]:
        return sorted((round(e.t, 7), e.contact, int(e.after)) for e in result.events)

    assert told(plain) == told(scaled) == told(other)
    for body in plain.scene.bodies:
        for result in (scaled, other):
            np.testing.assert_allclose(result.velocity(body.name), plain.velocity(body.name), rtol=0, atol=1e-7)


@pytest.mark.parametrize("seed", SEEDS)
def test_momentum_is_handed_on(seed: int) -> None:
    """Without friction, springs and loads from outside only the wall and the floor change the momentum of all."""
    scene = machine(seed)
    inner = [e for e in scene.elements if not isinstance(e, (Force, Spring, OneWay, Gear)) and e.label != "stop 'wall'"]
    inner = [e for e in inner if getattr(e, "name", "") not in ("floor", "wheel", "fly")]
    result = run(Scene(*inner))
    total = sum(body.inertia * result.velocity(body.name) for body in result.scene.bodies)
    assert np.abs(total - total[0]).max() < 1e-11


SMALL = (Body("a", inertia=1.0), Body("b", inertia=1.0), Drive("d", velocity=1.0))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Scene(*SMALL, Gap("g", "a", "x", upper=1, stiffness=1)), "gap 'g': no body is called 'x'"),
        (lambda: Scene(*SMALL, Stop("s", "x", "a", upper=1)), "stop 's': no body is called 'x'"),
        (lambda: Scene(*SMALL, Gap("g", "d", GROUND, upper=1, stiffness=1)), "gap 'g': neither"),
        (lambda: Scene(*SMALL, Stop("s", "d", GROUND, upper=1)), "stop 's': neither"),
        (
            lambda: Scene(*SMALL, Stop("s", "a", "b", upper=1), Gap("s", "a", "b", upper=1, stiffness=1)),
            "'s' stands twice; rename",
        ),
        (lambda: Stop("s", "a", "a", upper=1), "joins 'a' to itself; name two different bodies"),
        (lambda: Gap("g", "a", "a", upper=1, stiffness=1), "joins 'a' to itself"),
        (lambda: Stop("", "a", "b", upper=1), "name must be a name"),
        (lambda: Stop("s", "a", "b", upper="1"), "upper"),
        (lambda: Stop("s", "a", "b", upper=1, restitution="bouncy"), "restitution"),
        (lambda: Gap("g", "a", "b", upper=1, stiffness=math.nan), "stiffness"),
        (lambda: Scene.from_dict({"stops": [{"name": "s", "a": "a"}]}), "field 'b' is missing"),
        (
            lambda: Scene.from_dict({"gaps": [{"name": "g", "a": "a", "b": "b", "upper": 1}]}),
            "field 'stiffness' is missing",
        ),
        (
            lambda: Scene.from_dict({"gaps": [{"name": "g", "a": "a", "b": "b", "width": 1}]}),
            "unknown field 'width'",
        ),
        (lambda: Scene(*SMALL, Stop("s", "a", "b", upper=1)).replace("s", restitution=2), "restitution"),
    ],
)
def test_bad_limits_are_refused(make: Any, said: str) -> None:
    with pytest.raises((ValueError, TypeError)) as caught:
        make()
    assert said in str(caught.value)
