"""Values between computed points, for random laws, stiffnesses, tolerances, methods and times.

Tolerances must hold at every time, not only at the computed points. There are two kinds of right answers. With a closed
form, the error between the points is compared with that at the points. Without one, a very tight integration starts
from the package's own computed point before the time asked for, so that nothing but the interpolation is judged.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from stickslip import GROUND, Body, Contact, Damper, Drive, DryFriction, Result, Scene, Spring, simulate
from stickslip.model.laws import Shape
from validation.rows import Array, Row, Tried, require
from validation.tried import try_each

RUNS, TIMES = 30, 50  # runs of each family, and times asked for in a run
PATIENCE = 60.0
LARGEST = 3.0  # largest error that passes, as a multiple of that which the tolerances allow
_METHODS = (("contact-force", "BDF"), ("contact-force", "Adams"), ("merged", "BDF"), ("multiplier", "BDF"))


def _power(random: Any, low: float, high: float) -> float:
    return float(10.0 ** random.uniform(low, high))


def _options(random: Any, tightest: float = -11.0) -> dict[str, Any]:
    formulation, method = _METHODS[int(random.integers(len(_METHODS)))]
    rtol = _power(random, tightest, -4.0)
    return {"formulation": formulation, "method": method, "rtol": rtol, "atol": 1e-2 * rtol}


def _times(random: Any, shortest: float, stop: float) -> Array:
    """Return random times: half of them uniform, half uniform in their logarithms."""
    even = random.uniform(0.0, stop, TIMES // 2)
    return np.unique(np.append(even, stop * (shortest / stop) ** random.uniform(0.0, 1.0, TIMES - TIMES // 2)))


def _against(scene: Scene, stop: float, t: Array, options: dict[str, Any], error: Callable[[Result], float]) -> float:
    """Return the error at `t` over that at the computed points, or over the tolerance where that is larger."""
    own, at = simulate(scene, (0.0, stop), **options), simulate(scene, (0.0, stop), t_eval=t, **options)
    return error(at) / max(error(own), 10.0 * options["rtol"])


def oscillator(random: Any) -> float:
    """A body on a spring, undamped or with any damping: a sum of two exponentials."""
    omega, zeta = _power(random, 0.0, 5.0), float(random.choice([0.0, _power(random, -2.0, 3.0)]))
    root = np.sqrt(complex(zeta * zeta - 1.0))
    fast = -omega * (zeta + root)
    slow = omega * omega / fast
    stop = 10.0 / omega * max(1.0, 2.0 * zeta)
    options = _options(random)
    options["atol"] /= omega
    damping = 2.0 * zeta * omega
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Spring("m", GROUND, stiffness=omega**2, damping=damping))

    def error(r: Result) -> float:
        first, second = np.exp(fast * r.t), np.exp(slow * r.t)
        x, v = ((first - second) / (fast - slow)).real, ((fast * first - slow * second) / (fast - slow)).real
        wrong = (np.abs(r.velocity("m") - v).max(), omega * np.abs(r.position("m") - x).max())
        return float(max(wrong))

    return _against(scene, stop, _times(random, 1e-3 / abs(fast), stop), options, error)


def damper(random: Any) -> float:
    """Two masses and a damper of any strength: an exponential, and the heat of all that is lost."""
    c, m, options = _power(random, 0.0, 10.0), 1.2, _options(random)
    scene = Scene(
        Body("a", inertia=2.0, velocity=1.0),
        Body("b", inertia=3.0, velocity=-0.5),
        Damper("a", "b", damping=c),
    )
    rate, stop = c / m, 5.0

    def error(r: Result) -> float:
        w = 1.5 * np.exp(-rate * r.t)
        heat = r.energy().dampers["damper 'a'-'b'"]
        exact = 0.5 * m * 1.5**2 * -np.expm1(-2.0 * rate * r.t)
        wrong = (
            np.abs(r.velocity("a") - (0.1 + 0.6 * w)).max(),
            np.abs(r.velocity("b") - (0.1 - 0.4 * w)).max(),
            np.abs(heat - exact).max() / 1.35,
        )
        return float(max(wrong))

    return _against(scene, stop, _times(random, 1e-3 / rate, stop), options, error)


def _from_own_points(r: Result, t: Array, rate: Callable[[float, Array], Array], method: str) -> float:
    """Return the largest error of velocities at `t`, each from the computed point before it."""
    place = np.searchsorted(r.t, t, side="right") - 1
    found, wrong = r(t)[0], 0.0
    for k, i in enumerate(place.tolist()):
        if t[k] <= r.t[i]:
            continue
        start = [r.position("m")[i], r.velocity("m")[i]]
        exact = solve_ivp(rate, (r.t[i], t[k]), start, method=method, rtol=3e-14, atol=1e-16)
        require(bool(exact.success), f"the reference fails: {exact.message}")
        wrong = max(wrong, abs(float(found[k] - exact.y[1, -1])))
    return wrong


def smooth_law(random: Any) -> float:
    """A block on a belt under a smooth law: thin layers that long steps follow after short ones."""
    shape: Shape = "tanh" if random.choice(["tanh", "arctan"]) == "tanh" else "arctan"
    speed = 0.2
    velocity, options = _power(random, -6.0, -2.0), _options(random, -8.0)
    dry = DryFriction(1.0, 0.4, stribeck_velocity=0.3)
    scene = Scene(
        Body("m", inertia=1.0),
        Drive("belt", velocity=speed),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", "belt", dry, normal=1.0),
    ).regularized(velocity, shape)

    def rate(t: float, y: Array) -> Array:
        w = y[1] - speed
        step = math.tanh(w / velocity) if shape == "tanh" else 2 / math.pi * math.atan(0.5 * math.pi * w / velocity)
        return np.array([y[1], -y[0] - (0.4 + 0.6 * math.exp(-((w / 0.3) ** 2))) * step])

    r = simulate(scene, (0.0, 12.0), **options)
    steps = random.integers(0, r.t.size - 1, TIMES)
    t = r.t[steps] + random.uniform(0.0, 1.0, TIMES) * np.diff(r.t)[steps]
    return _from_own_points(r, t, rate, "Radau") / (10.0 * options["rtol"])


def kinetic_curve(random: Any) -> float:
    """A block on a belt under a curve with a slope at rest: half of the times in the last steps before it sticks."""
    speed, slope = float(random.uniform(0.1, 0.5)), _power(random, -0.3, 0.7)
    leine, options = bool(random.integers(2)), _options(random)

    def mu(w: float) -> float:
        return 1.0 / (1.0 + slope * w) if leine else 0.4 + 0.6 * math.exp(-slope * w)

    if leine:
        law = DryFriction(1.0, 1.0, kinetic=lambda v: 1.0 / (1.0 + slope * abs(v)))
    else:
        law = DryFriction(1.0, 0.4, stribeck_velocity=1.0 / slope, stribeck_exponent=1.0)
    scene = Scene(
        Body("m", inertia=1.0),
        Drive("belt", velocity=speed),
        Contact("c", "m", "belt", law, normal=1.0),
        Spring("m", GROUND, stiffness=1.0),
    )
    r = simulate(scene, (0.0, 30.0), **options)
    stuck = [e for e in r.events if int(e.after) == 0]
    require(len(stuck) > 0, "the block never sticks")
    moving = np.flatnonzero((r.mode("c")[:-1] != 0) & (np.diff(r.t) > 0))
    last = np.concatenate([int(np.searchsorted(r.t, e.t)) - 1 - np.arange(8) for e in stuck])
    steps = np.append(random.choice(moving, TIMES // 2), random.choice(np.intersect1d(last, moving), TIMES // 2))
    t = r.t[steps] + random.uniform(0.0, 1.0, steps.size) * np.diff(r.t)[steps]
    sign = {int(mode) for mode in r.mode("c")[steps]}
    require(sign == {-1}, f"the block slips in modes {sign}")

    def rate(t: float, y: Array) -> Array:
        # beyond rest the curve depends on the speed, as in the package
        return np.array([y[1], -y[0] + mu(abs(y[1] - speed))])

    return _from_own_points(r, t, rate, "DOP853") / (10.0 * options["rtol"])


FAMILIES: dict[str, Callable[[Any], float]] = {
    "oscillator": oscillator,
    "damper": damper,
    "smooth-law": smooth_law,
    "kinetic-curve": kinetic_curve,
}


def measure(family: str, number: int) -> float:
    """Return the error of one random run, as a multiple of that which the tolerances allow."""
    return FAMILIES[family](np.random.default_rng([number, len(family)]))


def runs(family: str, count: int) -> Tried:
    """Try random runs of a family."""
    return try_each(((f"run {n}", partial(measure, family, n)) for n in range(count)), limit=PATIENCE)


def rows(count: int) -> list[Row]:
    """Return a row for each family, with `count` runs."""
    return [
        Row(
            "Between computed points",
            f"between-{family}",
            f"{count} random runs, {TIMES} times each, over ten times rtol or the error at the points",
            "a closed form" if family in ("oscillator", "damper") else "integration from the point before, to roundoff",
            partial(runs, family, count),
            LARGEST,
            limit=60.0 + 20.0 * count,
            tries="runs read off between their points",
        )
        for family in FAMILIES
    ]
