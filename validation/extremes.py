"""Rows at the ends of every scale: a correct answer within a stated bound, or a clear error; never a hang."""

from __future__ import annotations

import itertools
import math
import time
import tracemalloc
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Result,
    Scene,
    Signal,
    Spring,
    piecewise_linear,
    signal,
    simulate,
    sine,
    step,
    triangle,
)
from validation import analytic
from validation.exact import TIGHT, pulled_block, two_flywheels
from validation.rows import FORMULATIONS, Answer, Row, changes, event_error, refused, require, worst

extreme_row = partial(Row, "Extremes")
mp = analytic.mp
DRY = DryFriction(0.5, 0.4)
FLOOR = 10.0
"""Normal force in N: the block breaks loose at 5 N and slides at 4 N."""


def block(
    load: Signal | float, normal: Signal | float = FLOOR, law: DryFriction = DRY, speed: float = 0.0
) -> Scene:
    """Return a block of 1 kg on the floor under a load."""
    return Scene(
        Body("block", inertia=1.0, velocity=speed),
        Contact("floor", "block", GROUND, law, normal=normal),
        Force("block", load),
    )


def told(
    scene: Scene, stop: float, events: Sequence[Any], speeds: dict[float, float], **options: Any
) -> Answer:
    """Compare a block's events (over the span) and its velocities at some times (over the largest)."""
    t = sorted(speeds)
    result = simulate(scene, (0.0, stop), t_eval=t, **options)
    found = [(e.t, e.contact, int(e.before), int(e.after)) for e in result.events]
    times = event_error(found, events, stop)
    return max(times, worst(result.velocity("block"), [speeds[s] for s in t]))


# Inertias, units


def inertia_ratio(ratio: float) -> Answer:
    """Two bodies lock: time, common speed, then the force between them under a load, by eq. (1)."""
    exact = analytic.lock_up(1, ratio, 1, 4)
    stop = 4 * float(exact.time)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=ratio),
        Contact("c", "a", "b", DRY, normal=10.0),
        Force("a", step(0.5 * stop, 0.0, 3.0)),
    )
    result = simulate(scene, (0.0, stop), t_eval=[0.4 * stop, 0.6 * stop])
    times = event_error(changes(result), [(exact.time, "c", 1, 0)], stop)
    common = 1 / (1 + mp.mpf(ratio))
    speeds = [float(common), float(common + 3 * mp.mpf(0.1 * stop) / (1 + mp.mpf(ratio)))]
    v = max(abs(result.velocity(n) - speeds).max() / speeds[1] for n in ("a", "b"))
    lam = worst(result.force("c"), [0.0, float(analytic.stick_phase(3, 0, 1, ratio).force)])
    return max(times, float(v), lam)


def units(decades: tuple[int, ...]) -> Answer:
    """The benchmark in other units of force, inertia and time: the same dimensionless motion."""
    story = two_flywheels()
    errors = []
    for f, m, s in itertools.product(decades, repeat=3):
        force, inertia, second = 10.0**f, 10.0**m, 10.0**s
        speed = force * second / inertia
        law = DryFriction(0.2, 0.1, dwell=0.1 * second)
        slope = 3000.0 * force / second
        first, second_pulse = (
            triangle(a * second, b * second, c * second, slope=slope)
            for a, b, c in ((0.05, 0.1, 0.15), (0.4, 0.5, 0.6))
        )
        scene = Scene(
            Body("wheel1", inertia=inertia, velocity=speed),
            Body("wheel2", inertia=10.0 * inertia, velocity=1.01 * speed),
            Contact("interface", "wheel1", "wheel2", law, normal=100.0 * force),
            Contact("brake", "wheel1", GROUND, law, normal=first + second_pulse),
        )
        result = simulate(scene, (0.0, 4.0 * second), atol=1e-10 * speed, t_eval=story.t * second)
        events = [(t * second, *rest) for t, *rest in story.events]
        errors.append(event_error(changes(result), events, 4.0 * second))
        v = np.array([result.velocity(b) for b in story.bodies]).T
        errors.append(worst(v / speed, story.velocities))
    return max(errors), f"{len(errors) // 2} combinations"


def units_of_spring(decades: tuple[int, ...]) -> Answer:
    """The pulled block in other units: integrated, so that tolerances must be in the new units too."""
    story = pulled_block()
    errors = []
    for f, m, s in itertools.product(decades, repeat=3):
        force, inertia, second = 10.0**f, 10.0**m, 10.0**s
        speed = force * second / inertia
        scene = Scene(
            Body("block", inertia=inertia),
            Drive("plate", velocity=0.1 * speed),
            Contact("floor", "block", GROUND, DryFriction(1.5, 1.0), normal=force),
            Spring("block", "plate", stiffness=2.0 * inertia / second**2),
        )
        atol = 1e-12 * min(speed, speed * second)
        result = simulate(scene, (0.0, 40.0 * second), rtol=1e-10, atol=atol, t_eval=story.t * second)
        events = [(t * second, *rest) for t, *rest in story.events]
        errors.append(event_error(changes(result), events, 40.0 * second))
        errors.append(worst(result.velocity("block")[:, None] / speed, story.velocities))
    return max(errors), f"{len(errors) // 2} combinations"


# Pre-slip velocities, dwell times, coefficients


def creep(velocity: float) -> Answer:
    """A block of 1/v kg in pre-slip under 3 N creeps: w = w1 (1 - exp(-t/T)), w1 = 3 v/5, T = 0.2 s."""
    scene = block(3.0).replace("block", inertia=1.0 / velocity).regularized(velocity)
    result = simulate(scene, (0.0, 4.0), rtol=1e-8, atol=1e-10 * velocity, t_eval=[0.1, 0.2, 0.4, 0.8, 4.0])
    exact = 0.6 * velocity * (1 - np.exp(-5.0 * result.t))
    return worst(result.velocity("block"), exact)


def preslip(velocity: float) -> Answer:
    """The benchmark with a pre-slip velocity: the exact motion is approached in proportion to it.

    Beside speeds of 1 rad/s double precision does not resolve velocities below 1e-10: these must be refused.
    """
    story = two_flywheels()
    if velocity <= 1e-10:
        run = partial(simulate, story.scene.regularized(velocity), (0.0, 4.0))
        return refused(run, "'interface'", "pre-slip velocity"), "refused, as it must be"
    result = simulate(story.scene.regularized(velocity), (0.0, 4.0), t_eval=story.t, **TIGHT)
    v = np.array([result.velocity(b) for b in story.bodies]).T
    return worst(v, story.velocities)


def dwell(tau: float) -> Answer:
    """A ramp of 0.1 N/s on a block: it breaks loose where the ramp meets the rising level."""
    scene = block(piecewise_linear([0.0, 100.0], [0.0, 10.0]), law=DryFriction(0.5, 0.4, dwell=tau))
    rate, t = mp.mpf(10) / 100, analytic.exact(tau)
    broken = mp.findroot(lambda s: rate * s - 5 + mp.exp(-s / t), (mp.mpf(40), mp.mpf(50)), solver="anderson")
    stop = 60.0
    gained = mp.mpf(stop) - broken
    speed = (rate * broken - 4) * gained + rate * gained**2 / 2
    return told(scene, stop, [(broken, "floor", 0, 1)], {stop: float(speed)})


def ratio_on_ramp(ratio: float) -> Answer:
    """A ramp on a block: breakaway at mu_s N, then slip against mu_c N."""
    level = 4.0 * ratio
    law = DryFriction(0.4 * ratio, 0.4)
    stop = 2.0 * level
    scene = block(piecewise_linear([0.0, stop], [0.0, stop]), law=law)
    gained = stop - level
    return told(scene, stop, [(level, "floor", 0, 1)], {stop: (level - 4.0) * gained + gained**2 / 2})


def ratio_pulled(ratio: float) -> Answer:
    """Stick-slip of a pulled block: events and velocities over two cycles."""
    motion = analytic.pulled_block(1, 2, 0.1, normal=1, mu_static=ratio, mu_coulomb=1)
    stop = float(motion.first_break + 2 * (motion.slip_time + motion.stick_time)) - 0.01
    scene = Scene(
        Body("block", inertia=1.0),
        Drive("plate", velocity=0.1),
        Contact("floor", "block", GROUND, DryFriction(ratio, 1.0), normal=1.0),
        Spring("block", "plate", stiffness=2.0),
    )
    t = np.concatenate(
        [np.linspace(0, stop, 50)] + [float(e.time) + np.linspace(-1, 1, 20) for e in motion.events(stop)]
    )
    t = np.unique(t[(t >= 0) & (t <= stop)])
    result = simulate(scene, (0.0, stop), t_eval=t, **TIGHT)
    times = event_error(changes(result), motion.events(stop), stop)
    v = [float(motion.state(mp.mpf(s))[1]) for s in t.tolist()]
    return max(times, worst(result.velocity("block"), v))


def equal_coefficients_pulled() -> Answer:
    """With mu_s = mu_c the pulled block slips at v (1 - cos(omega s)), which touches 0 again and again."""
    law = DryFriction(1.0, 1.0)
    scene = Scene(
        Body("block", inertia=1.0),
        Drive("plate", velocity=0.1),
        Contact("floor", "block", GROUND, law, normal=1.0),
        Spring("block", "plate", stiffness=2.0),
    )
    t = np.linspace(0.0, 40.0, 401)
    result = simulate(scene, (0.0, 40.0), t_eval=t, **TIGHT)
    v = np.where(t < 5, 0.0, 0.1 * (1 - np.cos(math.sqrt(2) * (t - 5))))
    require(bool(result.events) and abs(result.events[0].t - 5.0) < 1e-8, "breakaway at 5 s is not found")
    return worst(result.velocity("block"), v), f"{len(result.events)} changes of mode"


def frictionless() -> Answer:
    """A contact without friction does nothing and costs nothing."""
    result = simulate(block(2.0, law=DryFriction(0.0, 0.0), speed=-1.0), (0.0, 2.0), t_eval=[0.5, 2.0])
    require(not [e for e in result.events if e.cause != "open"], "a frictionless contact has events")
    require(not result.force("floor").any(), "a frictionless contact has a force")
    return worst(result.velocity("block"), [0.0, 3.0])


# Normal forces


def no_normal_force() -> Answer:
    """N = 0 all the time: free motion."""
    result = simulate(block(2.0, normal=0.0), (0.0, 2.0), t_eval=[0.5, 2.0])
    require(not result.force("floor").any(), "an open contact has a force")
    return worst(result.velocity("block"), [1.0, 4.0])


def normal_crosses_zero(load: float) -> Answer:
    """N = 10 - t while the block is stuck: it breaks at N = 2 F, slides at 0.4 N, and is free from 10 s on."""
    normal = piecewise_linear([0.0, 20.0], [10.0, -10.0])
    scene = block(load, normal=normal)
    if load == 0:
        result = simulate(scene, (0.0, 20.0), t_eval=np.linspace(0, 20, 81))
        require(
            not [e for e in result.events if e.after not in (e.before, 0)],
            "a block at rest starts to move",
        )
        return float(np.abs(result.velocity("block")).max() + np.abs(result.force("floor")).max())
    broken = 10 - 2 * load
    speed = {
        t: load * (t - broken) - 0.4 * ((10 - broken) ** 2 - max(10 - t, 0) ** 2) / 2
        for t in (broken, 9.5, 10.0, 20.0)
    }
    return told(scene, 20.0, [(broken, "floor", 0, 1)], speed)


def normal_jumps() -> Answer:
    """N drops from 10 to 1 N at 1 s: the block breaks; at 2 s it jumps to 20 N: it stops, and is held."""
    normal = piecewise_linear([0.0, 1.0, 1.0, 2.0, 2.0, 3.0], [10.0, 10.0, 1.0, 1.0, 20.0, 20.0])
    stops = 2 + (3 - 0.4) / (8 - 3)
    events = [(1.0, "floor", 0, 1), (stops, "floor", 1, 0)]
    return told(block(3.0, normal=normal), 4.0, events, {1.5: 1.3, 2.0: 2.6, 2.26: 1.3, 2.6: 0.0, 4.0: 0.0})


def normal_returns() -> Answer:
    """N is gone between 1 and 2 s: a block at rest under 3 N flies off, lands again with 4 N of friction."""
    normal = piecewise_linear([0.0, 1.0, 1.0, 2.0, 2.0, 3.0], [10.0, 10.0, 0.0, 0.0, 10.0, 10.0])
    result = simulate(block(3.0, normal=normal), (0.0, 6.0), t_eval=[1.0, 2.0, 3.5, 5.0, 6.0])
    stop = [e.t for e in result.events if int(e.after) == 0]
    require(len(stop) == 1, f"stuck {len(stop)} times after landing instead of once")
    return max(abs(stop[0] - 5.0) / 6, worst(result.velocity("block"), [0.0, 3.0, 1.5, 0.0, 0.0]))


# Short pulses, grazing, thresholds


def _pulse(times: tuple[float, float, float], peak: float) -> tuple[list[Any], Any]:
    """Break and stop time, and the speed of the block of 1 kg, under a triangle; in exact arithmetic on the floats."""
    start, top, end = map(mp.mpf, times)
    up, down = peak / (top - start), peak / (end - top)
    broken = start + 5 / up
    at_top = (peak - 4 + 1) / mp.mpf(2) * (top - broken)
    at_end = at_top + (end - top) * (mp.mpf(peak) / 2 - 4)
    require(bool(down > 0 and at_end > 0), "the pulse must move the block to its end")
    stops = end + at_end / 4
    return [(broken, "floor", 0, 1), (stops, "floor", 1, 0)], at_end


def short_pulse(kind: str) -> Answer:
    """A pulse of 1e-6 s and 100 N after 5000 s of rest, in a window of 1e4 s."""
    times = (5000.0, 5000.0 + 5e-7, 5000.0 + 1e-6)
    events, speed = _pulse(times, 100)
    if kind == "function":
        knots, values = np.array(times), np.array([0.0, 100.0, 0.0])
        load = signal(lambda t: float(np.interp(t, knots, values)), breaks=times)
    else:
        load = piecewise_linear(times, [0.0, 100.0, 0.0])
    result = simulate(block(load), (0.0, 1e4), t_eval=[4999.0, times[2], 1e4])
    late = event_error(changes(result), events, 1.0)
    allowed = 2e-12 if kind == "triangle" else 5e-11
    require(late <= allowed, f"event times are {late:.1e} s off; doubles lie 9e-13 s apart there")
    return worst(result.velocity("block"), [0.0, float(speed), 0.0]), f"event times within {late:.1e} s"


def short_brake() -> Answer:
    """A brake of 1e-6 s in 1e4 s takes its impulse from a wheel, and nothing else happens."""
    times = (5000.0, 5000.0 + 5e-7, 5000.0 + 1e-6)
    result = simulate(
        block(0.0, normal=piecewise_linear(times, [0.0, 1e6, 0.0]), speed=1.0), (0.0, 1e4), t_eval=[4e3, 1e4]
    )
    width = float(mp.mpf(times[2]) - mp.mpf(times[0]))
    return worst(result.velocity("block"), [1.0, 1.0 - 0.4 * 1e6 * width / 2])


def graze(kind: str, excess: float) -> Answer:
    """A load whose peak is (1 + excess) times the breakaway level: the first breakaway, or none at all."""
    peak = 5.0 * (1 + excess)
    excess = float(mp.mpf(peak) / 5 - 1)
    if kind == "sine":
        load: Signal = sine(peak, 1.0)
        broken = mp.asin(1 / (1 + mp.mpf(excess))) / (2 * mp.pi) if excess > 0 else None
    else:
        load = piecewise_linear([0.0, 1.0, 2.0, 3.0], [0.0, peak, 0.0, 0.0])
        broken = 1 / (1 + mp.mpf(excess)) if excess > 0 else None
    scene = block(load)
    if kind == "spring":
        scene, broken = _spring_graze(peak)
    result = simulate(scene, (0.0, 10.0), rtol=1e-12, atol=1e-14)
    first = changes(result)[:1]
    if broken is None:
        require(
            not first,
            f"breakaway at {first[0][0] if first else 0:.9g} s under a load that never reaches the level",
        )
        return float(np.abs(result.velocity("block")).max())
    return event_error(first, [(broken, "floor", 0, 1)], 10.0)


def _spring_graze(peak: float) -> tuple[Scene, Any]:
    """A mass swings on a spring that pulls the block: its force is peak sin(t)."""
    scene = Scene(
        Body("block", inertia=1.0),
        Body("mass", inertia=1.0, velocity=peak),
        Contact("floor", "block", GROUND, DRY, normal=FLOOR),
        Spring("block", "mass", stiffness=1.0),
    )
    return scene, mp.asin(5 / mp.mpf(peak)) if peak > 5 else None


def at_threshold(kind: str) -> Answer:
    """A start exactly at the breakaway level, or exactly between two answers."""
    if kind == "constant":
        return told(block(5.0), 10.0, [], {0.0: 0.0, 10.0: 0.0})
    if kind == "backward":
        return told(block(-5.0), 10.0, [], {0.0: 0.0, 10.0: 0.0})
    if kind == "falling":
        return told(block(piecewise_linear([0.0, 10.0], [5.0, 0.0])), 10.0, [], {0.0: 0.0, 10.0: 0.0})
    if kind == "rising":
        result = simulate(
            block(piecewise_linear([0.0, 10.0], [5.0, 15.0])), (0.0, 10.0), t_eval=[0.0, 5.0, 10.0]
        )
        require(
            len(result.events) <= 1 and all(e.t < 1e-12 for e in result.events), f"events {result.events}"
        )
        return worst(result.velocity("block"), [0.0, 17.5, 60.0])
    if kind == "spring":
        scene = Scene(
            Body("block", inertia=1.0, position=0.5),
            Contact("floor", "block", GROUND, DRY, normal=FLOOR),
            Spring("block", GROUND, stiffness=10.0),
        )
        return told(scene, 100.0, [], {0.0: 0.0, 100.0: 0.0})
    if kind == "above":
        result = simulate(block(5.0 * (1 + 1e-9)), (0.0, 1.0), t_eval=[1.0])
        return worst(result.velocity("block"), [1.0 + 5e-9])
    require(kind == "peak", f"unknown kind {kind}")
    return told(block(sine(5.0, 0.25)), 20.0, [], {0.0: 0.0, 1.0: 0.0, 20.0: 0.0}, rtol=1e-10)


# Symmetry, loops, many bodies, many events


def symmetric(count: int) -> Answer:
    """Pairs of blocks thrown against a hub from both sides: all lock at once, and the hub never moves."""
    names = [f"{side}{i}" for i in range(count) for side in "+-"]
    scene = Scene(
        Body("hub", inertia=3.0),
        *(Body(n, inertia=2.0, velocity=1.0 if n[0] == "+" else -1.0) for n in names),
        *(Contact(f"c{n}", n, "hub", DRY, normal=10.0) for n in names),
        *(
            Force(n, (1.0 if n[0] == "+" else -1.0) * piecewise_linear([1.0, 2.0], [0.0, 10.0]))
            for n in names
        ),
    )
    result = simulate(scene, (0.0, 2.0), t_eval=np.linspace(0.0, 2.0, 41))
    ways = {f"c{n}": 1 if n[0] == "+" else -1 for n in names}
    events = [(0.5, c, way, 0) for c, way in ways.items()] + [(1.5, c, 0, way) for c, way in ways.items()]
    error = event_error(changes(result), events, 2.0)
    require(len({e.t for e in result.events}) == 2, "simultaneous events have different times")
    require(not result.velocity("hub").any(), f"the hub moves at {np.abs(result.velocity('hub')).max():.1e}")
    return error


def together(count: int) -> Answer:
    """Equal blocks on a slowing belt all break loose in the same instant, and stick again in the same instant."""
    velocity = piecewise_linear([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 10.0, 10.0])
    scene = Scene(
        Drive("belt", velocity=velocity),
        *(Body(f"b{i}", inertia=1.0 + i % 3) for i in range(count)),
        *(Contact(f"c{i}", f"b{i}", "belt", DRY, normal=10.0 * (1 + i % 3)) for i in range(count)),
    )
    result = simulate(scene, (0.0, 5.0), t_eval=[1.0, 2.0, 3.0, 3.5, 5.0])
    # an acceleration of 10 needs more than mu_s g = 5; sliding gives 4: 4 (t - 1) = 10 at t = 3.5
    events = [(t, f"c{i}", *way) for t, way in ((1.0, (0, -1)), (3.5, (-1, 0))) for i in range(count)]
    error = event_error(changes(result), events, 5.0)
    v = [worst(result.velocity(f"b{i}"), [0.0, 4.0, 8.0, 10.0, 10.0]) for i in range(count)]
    return max(error, *v)


def loops(kind: str) -> Answer:
    """Forces in closed loops of stuck contacts: least norm among all that hold the motion, by pseudo-inverse."""
    random = np.random.default_rng(7)
    ends = {
        "doubled": [(0, 1), (0, 1), (1, 0), (1, 2)],
        "triangle": [(0, 1), (1, 2), (2, 0)],
        "grounded": [(0, 3), (1, 3), (0, 1), (1, 2)],
        "complete": [(i, j) for i in range(4) for j in range(i)],
    }[kind]
    bodies = 1 + max(e for pair in ends for e in pair) - (kind == "grounded")
    inertia, forces = random.uniform(0.5, 3.0, bodies), random.uniform(-1.0, 1.0, bodies)
    names = [f"b{i}" for i in range(bodies)] + [GROUND]
    scene = Scene(
        *(Body(names[i], inertia=float(m)) for i, m in enumerate(inertia)),
        *(Contact(f"c{k}", names[i], names[j], DRY, normal=100.0) for k, (i, j) in enumerate(ends)),
        *(Force(names[i], float(f)) for i, f in enumerate(forces)),
    )
    g = np.zeros((len(ends), bodies + 1))
    for k, (i, j) in enumerate(ends):
        g[k, i], g[k, j] = 1.0, -1.0
    g = g[:, :bodies]
    # all lambda with G M^-1 (F - G^T lambda) = 0; of these the shortest
    exact = np.linalg.pinv(g / inertia @ g.T, rcond=1e-10) @ (g / inertia @ forces)
    errors = []
    for f in FORMULATIONS:
        result = simulate(scene, (0.0, 1.0), formulation=f, t_eval=[0.0, 1.0], **TIGHT)
        found = np.array([result.force(f"c{k}") for k in range(len(ends))])
        errors.append(worst(found, np.column_stack([exact, exact])))
        require(not result.events, f"{f}: stuck contacts slip")
    return max(errors)


def doubled_capacity() -> Answer:
    """Two contacts of 4 N and 40 N between the same bodies hold together up to 44 N, however they share the load."""
    law = DryFriction(0.4, 0.4)
    scene = Scene(
        Body("block", inertia=1.0),
        Contact("weak", "block", GROUND, law, normal=10.0),
        Contact("strong", "block", GROUND, law, normal=100.0),
        Force("block", piecewise_linear([0.0, 100.0], [0.0, 100.0])),
    )
    t = [20.0, 43.9, 54.0, 64.0]
    result = simulate(scene, (0.0, 64.0), t_eval=t)
    return worst(result.velocity("block"), [0.0, 0.0, 50.0, 200.0])


def relief(kind: str) -> Answer:
    """A load that overloads two contacts at once; when the more overloaded one slips, the other holds after all."""
    scene = Scene(
        Body("sled", inertia=1.0),
        Body("rider", inertia=1.0),
        Contact("floor", "sled", GROUND, DRY, normal=FLOOR),  # 5 N, then 4 N
        Contact("seat", "rider", "sled", DRY, normal=14.0),  # 7 N: 8 N at first, 6 N once the floor slips
        Force("rider", step(1.0, 0.0, 8.0)),
    )
    result = simulate(scene, (0.0, 3.0), formulation=kind, t_eval=[1.0, 2.0, 3.0], **TIGHT)
    error = event_error(changes(result), [(1.0, "floor", 0, 1)], 3.0)
    return max(error, *(worst(result.velocity(b), [0.0, 2.0, 4.0]) for b in ("sled", "rider")))


def chain(count: int) -> Answer:
    """Wheels in a row, each rubbing on the next, free at both ends: all end at the mean of their speeds."""
    i = np.arange(count)
    speeds = 1 + 0.01 * np.sin(7.3 * i)
    normals = 100 * (1 + 0.5 * np.sin(3.1 * i))
    law = DryFriction(0.2, 0.1)
    scene = Scene(
        *(Body(f"w{k}", inertia=1.0, velocity=float(v)) for k, v in enumerate(speeds)),
        *(Contact(f"c{k}", f"w{k}", f"w{k + 1}", law, normal=float(normals[k])) for k in range(count - 1)),
    )
    stop = 0.5 * max(count, 10) / 10
    result = simulate(scene, (0.0, stop), t_eval=[0.5 * stop, stop], dense_output=False)
    final = result.y[:count, -1]
    momentum = np.abs(result.y[:count].mean(axis=0) - speeds.mean()).max()
    return max(float(np.abs(final - speeds.mean()).max()), float(momentum)), f"{len(result.events)} events"


def _pushed_again(count: int) -> tuple[Scene, list[Any]]:
    """6 N for a second, nothing for a second, again and again: it breaks at 2 k and stops at 2 k + 1.5 s."""
    k = np.arange(count)
    times = np.repeat(np.arange(2.0 * count + 1), 2)[1:-1]
    values = np.tile([6.0, 6.0, 0.0, 0.0], count)
    events = [e for t in 2.0 * k for e in ((t, "floor", 0, 1), (t + 1.5, "floor", 1, 0))]
    return block(piecewise_linear(times, values)), events[1:]


def many_events(count: int) -> Answer:
    """Break loose, slide, stop, and again: two events in each cycle; every time exact."""
    scene, events = _pushed_again(count // 2)
    result = simulate(scene, (0.0, float(count)), t_eval=[float(count)], dense_output=False)
    return event_error(changes(result), events, 1.0), f"{len(result.events)} events, errors in s"


def _seconds(count: int) -> float:
    scene, _ = _pushed_again(count // 2)
    start = time.process_time()
    simulate(scene, (0.0, float(count)), t_eval=[float(count)], dense_output=False)
    return (time.process_time() - start) / count


def time_per_event(few: int, many: int) -> Answer:
    """Time per event in a long run over that in a short one, less 1."""
    short, long = _seconds(few), _seconds(many)
    return max(
        long / short - 1, 0.0
    ), f"{1e6 * short:.0f} us per event of {few}, {1e6 * long:.0f} us of {many}"


def memory_per_event(few: int, many: int) -> Answer:
    """Memory per event in a long run over that in a short one, less 1; all of the motion is kept."""
    per_event = []
    for count in (few, many):
        scene, _ = _pushed_again(count // 2)
        tracemalloc.start()
        result = simulate(scene, (0.0, float(count)))
        per_event.append(tracemalloc.get_traced_memory()[1] / count)
        tracemalloc.stop()
        require(isinstance(result, Result), "no result")
    short, long = per_event
    return max(
        long / short - 1, 0.0
    ), f"{short / 1e3:.1f} kB per event of {few}, {long / 1e3:.1f} kB of {many}"


# Tolerances, and what must be refused


def tolerance(rtol: float) -> Answer:
    """The pulled block: error of event times over the span and of velocities over the largest, over rtol."""
    story = pulled_block()
    result = simulate(story.scene, (0.0, 40.0), rtol=rtol, atol=rtol * 1e-2, t_eval=story.t)
    times = event_error(changes(result), story.events, 40.0)
    v = worst(result.velocity("block")[:, None], story.velocities)
    return max(times, v) / rtol, f"error {max(times, v):.1e}"


def refusals(kind: str) -> Answer:
    """What cannot be simulated ends in an error that says why."""
    runs = {
        "negative inertia": (lambda: Body("a", inertia=-1.0), ("inertia", "-1")),
        "static below Coulomb": (lambda: DryFriction(0.1, 0.2), ("mu_static", "mu_coulomb")),
        "not a number": (
            lambda: simulate(block(signal(lambda t: math.nan if t > 0.5 else 0.0)), (0.0, 1.0)),
            (),
        ),
        "tolerance out of range": (lambda: simulate(block(0.0), (0.0, 1.0), rtol=1e-20), ("rtol",)),
        "time running back": (lambda: simulate(block(0.0), (1.0, 0.0)), ("t_span",)),
        "unknown body": (lambda: Scene(Body("a", inertia=1.0), Force("b", 1.0)), ("'b'",)),
        "load without end": (lambda: simulate(block(signal(lambda t: 1 / max(1 - t, 0.0))), (0.0, 2.0)), ()),
    }
    run, words = runs[kind]
    return refused(run, *words)


def _power(x: float) -> str:
    return f"1e{round(math.log10(x)):+d}"


def _rows() -> list[Row]:
    rows: list[Row] = []

    def add(name: str, what: str, source: str, check: Any, bound: float, **options: Any) -> None:
        rows.append(extreme_row(name, what, source, check, bound, **options))

    for k in (-12, -9, -6, -3, 3, 6, 9, 12):
        add(
            f"inertia-ratio-{_power(10.0**k)}",
            f"two bodies of inertia ratio {_power(10.0**k)}: time of locking, speeds, and the force of eq. (1)",
            "analytic.lock_up and stick_phase",
            partial(inertia_ratio, 10.0**k),
            1e-12,
        )
    add(
        "units",
        "the benchmark with forces, inertias and times times 1e-12, 1 and 1e12 in all combinations",
        "the same dimensionless problem; analytic.two_flywheels",
        partial(units, (-12, 0, 12)),
        1e-12,
    )
    add(
        "units-integrated",
        "the pulled block with forces, inertias and times times 1e-12 and 1e12 in all combinations",
        "the same dimensionless problem; analytic.pulled_block",
        partial(units_of_spring, (-12, 12)),
        1e-7,
    )
    for k in (-2, -4, -6, -8, -10, -12, -14):
        v = 10.0**k
        add(
            f"creep-{_power(v)}",
            f"pre-slip velocity {_power(v)}: a held block creeps; velocity over the largest",
            "exponential approach in closed form",
            partial(creep, v),
            1e-6,
        )
        add(
            f"pre-slip-{_power(v)}",
            f"pre-slip velocity {_power(v)}: "
            + (
                "the benchmark approaches its exact motion; velocities over the largest"
                if k > -10
                else "a clear error"
            ),
            "analytic.two_flywheels" if k > -10 else "an error is expected: not resolved beside 1 rad/s",
            partial(preslip, v),
            # Stuck, w/v is known to 1e-13/v, and so is the force over its level: breakaway comes 0.07 s times that
            # early or late, at up to 30 rad/s². No tolerance helps.
            3 * v + 1e-7 + 2e-13 / v if k > -10 else 0.0,
            limit=180.0,
        )
    for k in range(-9, 10, 3):
        add(
            f"dwell-{_power(10.0**k)}",
            f"dwell time {_power(10.0**k)} s: breakaway under a ramp, and the speed gained",
            "root of a t = (mu_s - (mu_s - mu_c) exp(-t/tau)) N, 40 digits",
            partial(dwell, 10.0**k),
            1e-12,
        )
    for k in (0, 1, 2, 4, 6):
        add(
            f"mu-ratio-ramp-{_power(10.0**k)}",
            f"mu_s/mu_c = {_power(10.0**k)}: breakaway under a ramp, and the speed gained",
            "t = mu_s N/a, then parabola",
            partial(ratio_on_ramp, 10.0**k),
            1e-12,
        )
        if k:
            add(
                f"mu-ratio-pulled-{_power(10.0**k)}",
                f"mu_s/mu_c = {_power(10.0**k)}: stick-slip of a pulled block over two cycles",
                "analytic.pulled_block",
                partial(ratio_pulled, 10.0**k),
                # a relative error of the position of 1e-9 shifts the next breakaway: omega x/v = 7 ratio times as much
                max(1e-7, 7e-9 * 10.0**k),
            )
    add(
        "mu-ratio-pulled-1e+0",
        "mu_s = mu_c: a pulled block whose velocity touches 0 without staying there",
        "v (1 - cos(omega s))",
        equal_coefficients_pulled,
        1e-7,
    )
    add("mu-zero", "no friction at all: free motion, no events, no force", "v0 + F t/m", frictionless, 1e-15)
    add("normal-zero", "no normal force: free motion", "F t/m", no_normal_force, 1e-15)
    add(
        "normal-crosses-zero-loaded",
        "the normal force falls through 0 while the loaded block is stuck: breakaway, slip, free flight",
        "parabolas",
        partial(normal_crosses_zero, 1.0),
        1e-13,
    )
    add(
        "normal-crosses-zero-idle",
        "the normal force falls through 0 over a block that nothing pushes: it stays at rest",
        "velocity and force 0, exactly",
        partial(normal_crosses_zero, 0.0),
        0.0,
    )
    add(
        "normal-jumps",
        "the normal force jumps down and up: breakaway and stop",
        "straight lines",
        normal_jumps,
        1e-13,
    )
    add("normal-returns", "the normal force is gone for a second", "straight lines", normal_returns, 1e-13)
    for kind in ("triangle", "function"):
        add(
            f"pulse-{kind}",
            f"a pulse of 1e-6 s ({kind}) in 1e4 s: event times, velocity over the largest",
            "parabolas in exact arithmetic",
            partial(short_pulse, kind),
            # a function of absolute time sees it in steps of 9e-13 s
            2e-8 if kind == "triangle" else 5e-6,
        )
    add(
        "pulse-brake", "a brake of 1e-6 s in 1e4 s takes its impulse", "mu_c times impulse", short_brake, 1e-9
    )
    for kind in ("sine", "triangle", "spring"):
        for excess in (-1e-9, 1e-9):
            side = "below" if excess < 0 else "above"
            add(
                f"graze-{kind}-{side}",
                f"a {kind} load whose peak stays 1e-9 {side} breakaway: "
                + ("nothing moves" if excess < 0 else "first breakaway, over the span"),
                "asin, straight line" if excess > 0 else "velocity 0, exactly",
                partial(graze, kind, excess),
                0.0 if excess < 0 and kind != "spring" else 1e-7,
            )
    about = {
        "constant": "load exactly at the level: holds for ever",
        "backward": "load exactly at the lower level: holds for ever",
        "falling": "load starts at the level and falls: holds",
        "rising": "load starts at the level and rises: slips from the start",
        "spring": "spring force exactly at the level: holds for ever",
        "above": "load 1e-9 above the level: slips from the start",
        "peak": "sine whose peak touches the level: holds",
    }
    for kind, what in about.items():
        add(
            f"threshold-{kind}",
            what,
            "|lambda| <= B holds, more does not",
            partial(at_threshold, kind),
            1e-13,
        )
    for count in (1, 4):
        add(
            f"symmetry-{2 * count}",
            f"{2 * count} blocks lock on a hub in the same instant and break loose in the same instant; the hub rests",
            "t = 0.5 s and 1.5 s; velocity of the hub 0, exactly",
            partial(symmetric, count),
            1e-14,
        )
    add(
        "together-12",
        "12 blocks on a belt break and stick in the same instants",
        "straight lines",
        partial(together, 12),
        1e-13,
    )
    for kind in ("doubled", "triangle", "grounded", "complete"):
        add(
            f"loop-{kind}",
            f"stuck contacts in closed loops ({kind}): forces, in three formulations",
            "least norm, by pseudo-inverse",
            partial(loops, kind),
            1e-8,
        )
    add(
        "doubled-capacity",
        "two contacts between the same bodies hold as much as both",
        "parabola",
        doubled_capacity,
        1e-12,
    )
    for kind in FORMULATIONS:
        add(
            f"relief/{kind}",
            f"a jump overloads two contacts; one slips, and so the other holds ({kind})",
            "eq. (1), straight lines",
            partial(relief, kind),
            1e-7 if kind == "multiplier" else 1e-13,
        )
    for count in (1, 2, 10, 100, 1000, 10_000):
        add(
            f"chain-{count}",
            f"{count} wheels in a row come to rest on each other: final speeds, and momentum on the way",
            "mean of the initial speeds",
            partial(chain, count),
            1e-12,
            quick=count < 1000,
            limit=60.0 if count < 10_000 else 1800.0,
        )
    for count in (1000, 100_000):
        add(
            f"events-{count}",
            f"{count} events in one run: time of each, in s",
            "2 k and 2 k + 1.5 s",
            partial(many_events, count),
            1e-14 * count,
            quick=count <= 1000,
            limit=900.0,
        )
    add(
        "events-time",
        "time per event does not grow with their number",
        "ratio",
        partial(time_per_event, 500, 2000),
        0.5,
    )
    add("events-memory", "memory per event does not grow", "ratio", partial(memory_per_event, 100, 400), 0.2)
    add(
        "events-time-long",
        "time per event does not grow up to 1e5 events",
        "ratio",
        partial(time_per_event, 10_000, 100_000),
        0.5,
        quick=False,
        limit=300.0,
    )
    for k in range(-3, -14, -1):
        add(
            f"rtol-{_power(10.0**k)}",
            f"pulled block at rtol {_power(10.0**k)}: errors in units of rtol",
            "analytic.pulled_block",
            partial(tolerance, 10.0**k),
            1e3 if k > -12 else 1e4,
        )
    for kind in (
        "negative inertia",
        "static below Coulomb",
        "not a number",
        "tolerance out of range",
        "time running back",
        "unknown body",
        "load without end",
    ):
        name = "refuses-" + kind.lower().replace(" ", "-")
        add(name, f"{kind}: a clear error, no answer", "an error is expected", partial(refusals, kind), 0.0)
    return rows


ROWS = _rows()
