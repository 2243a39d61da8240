"""What Breedveld (2000) claims, beside what is measured here.

    python -m benchmarks.claims [--only KEY ...] [--repeats 5]

Every number comes from a run. Times are compared as ratios: the two sides take turns, and the medians count.
Errors are the largest over both wheels and 2000 times, against the event-exact run of the contact-force model,
which itself agrees with 40-digit arithmetic to roundoff.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from statistics import median

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    DryFriction,
    Force,
    Karnopp,
    Result,
    Scene,
    SimulationError,
    piecewise_linear,
    simulate,
)
from stickslip.benchmark import (
    BENCHMARK_SPAN,
    EXACT_EVENTS,
    EXACT_FINAL_VELOCITY,
    flywheel_benchmark,
    four_flywheels,
)

PRE_SLIP = 1e-3  # the paper's pre-slip velocity in rad/s (table 1)

# Viscous friction between the four flywheels in N m s/rad; from 2 on the brake no longer stops the first wheel.
VISCOUS = 1.0
SETTLED = (0.0, 1.0)  # the part of the benchmark in which anything happens
LEVELS = (1e-2, 3e-3, 1e-3)
_GRID, _WIDTH = 1.12, 72

Line = tuple[str, str]  # the quantity that is measured, and its value


def _virtually_identical(repeats: int) -> Iterator[Line]:
    hard = simulate(flywheel_benchmark(), BENCHMARK_SPAN)
    soft = simulate(flywheel_benchmark().regularized(PRE_SLIP), BENCHMARK_SPAN)
    exact = max(abs(e.t - x.t) for e, x in zip(hard.events, EXACT_EVENTS, strict=True))
    yield "contact force: events, largest distance to the exact times", f"{len(hard.events)}, {exact:.1e} s"
    off = max(abs(hard.velocity(w)[-1] - EXACT_FINAL_VELOCITY) for w in ("wheel1", "wheel2"))
    yield "contact force: final velocity, distance to the exact one", f"{off:.1e} rad/s"
    yield "pre-slip 0.001 rad/s: the same events in the same order", _yes(_changes(soft) == _changes(hard))
    apart = max(abs(a.t - b.t) for a, b in zip(hard.events, soft.events, strict=True))
    yield "largest difference of event times", f"{apart:.1e} s"
    difference = _error(soft, hard, BENCHMARK_SPAN)
    yield "largest difference of velocities", f"{difference:.1e} rad/s = {difference / PRE_SLIP:.2f} v_pre"
    for event in hard.events:
        yield f"  {event.contact} {event.before.name} -> {event.after.name}", f"{event.t:.9f} s"


def _fixed_steps(repeats: int) -> Iterator[Line]:
    exact = simulate(flywheel_benchmark(), SETTLED)
    hard, soft = flywheel_benchmark(), flywheel_benchmark().regularized(PRE_SLIP)
    stability = 2.785 * PRE_SLIP / (0.2 * 100.0 * 1.1)
    yield "RK4 on pre-slip is stable below 2.785 v_pre m / (mu_s N)", f"{stability:.3g} s"
    found: dict[str, dict[float, float]] = {"hard": {}, "soft": {}}
    for name, scene, first in (("hard", hard, 1e-2), ("soft", soft, 1.25 * stability)):
        found[name] = dict(_cheapest(scene, exact, first))
    for level in LEVELS:
        h, s = found["hard"][level], found["soft"][level]
        stepped = partial(simulate, t_span=BENCHMARK_SPAN, method="RK4")
        fast, slow, ratio = _in_turn(partial(stepped, hard, step=h), partial(stepped, soft, step=s), repeats)
        calls = slow.nfev / fast.nfev
        yield (
            f"error {level:g} rad/s: steps {h:.2g} s and {s:.2g} s",
            f"{h / s:.1f} x fewer steps, {calls:.1f} x fewer calls, {ratio:.1f} x faster",
        )


def _cheapest(scene: Scene, exact: Result, first: float) -> Iterator[tuple[float, float]]:
    """Yield for each level the longest RK4 step that meets it together with the two next shorter ones."""
    step, errors, levels = first, [math.inf] * 3, list(LEVELS)
    while levels:
        try:
            error = _error(simulate(scene, SETTLED, method="RK4", step=step), exact, SETTLED)
        except SimulationError:  # unstable
            error = math.inf
        errors = [*errors[1:], error]
        while levels and max(errors) <= levels[0]:
            yield levels.pop(0), step * _GRID**2
        step /= _GRID


def _bdf(repeats: int) -> Iterator[Line]:
    for title, scene, span in (
        ("two flywheels", flywheel_benchmark(), BENCHMARK_SPAN),
        ("four flywheels", four_flywheels(), BENCHMARK_SPAN),
        ("four flywheels, viscous", four_flywheels(viscous=VISCOUS), BENCHMARK_SPAN),
    ):
        loose = partial(simulate, t_span=span, method="BDF", rtol=1e-5, atol=1e-7)
        hard, soft, ratio = _in_turn(partial(loose, scene), partial(loose, scene.regularized(PRE_SLIP)), repeats)
        calls = f"{soft.nfev} calls against {hard.nfev}, {soft.nfev / hard.nfev:.1f} x fewer"
        yield f"{title}, rtol 1e-5: contact force against pre-slip", f"{calls}; {ratio:.1f} x faster"
        error = _error(soft, simulate(scene, span), span)
        yield "  pre-slip error at that tolerance", f"{error:.1e} rad/s = {error / PRE_SLIP:.2f} v_pre"


def _stiff(repeats: int) -> Iterator[Line]:
    for velocity in (1e-2, 1e-3, 1e-4, 1e-5):
        result = simulate(flywheel_benchmark().regularized(velocity), (0.0, 0.04))
        fastest = _fastest(result)
        yield (
            f"pre-slip {velocity:g} rad/s: fastest eigenvalue while sticking",
            f"{fastest:.3g} /s, times v_pre {fastest * velocity:.3g}",
        )
    yield "contact force, sticking or slipping", f"{_fastest(simulate(flywheel_benchmark(), SETTLED)):g} /s"
    viscous = simulate(four_flywheels(viscous=VISCOUS), SETTLED)
    yield "contact force with viscous friction (its own time scale)", f"{_fastest(viscous):.3g} /s"


def _fastest(result: Result) -> float:
    """Return the largest eigenvalue of the Jacobian at the computed points."""
    worst = 0.0
    for number, piece in enumerate(result.trajectory.pieces):
        motion = result.trajectory.motion(number)
        assert piece.path is not None
        for tau, y in zip(piece.path.taus.tolist(), piece.path.points, strict=True):
            worst = max(worst, float(np.abs(np.linalg.eigvals(motion.jacobian(tau, y))).max()))
    return worst


def _real_time(repeats: int) -> Iterator[Line]:
    span = BENCHMARK_SPAN
    for title, scene in (
        ("two flywheels", flywheel_benchmark()),
        ("four flywheels", four_flywheels()),
        ("four flywheels, viscous", four_flywheels(viscous=VISCOUS)),
    ):
        run = partial(simulate, t_span=span, method="BDF")
        hard = _factor(partial(run, scene), span, repeats)
        soft = _factor(partial(run, scene.regularized(PRE_SLIP)), span, repeats)
        yield f"{title}, BDF: contact force, pre-slip", f"{hard:.0f} and {soft:.0f} times real time"
    hard = _factor(lambda: simulate(four_flywheels(), span, method="RK4", step=1e-3), span, repeats)
    yield "four flywheels, RK4, contact force, step 1 ms", f"{hard:.0f} times real time"
    scene = four_flywheels().regularized(PRE_SLIP)
    soft = _factor(lambda: simulate(scene, span, method="RK4", step=5e-5), span, 1)
    yield "four flywheels, RK4, pre-slip, step 0.05 ms", f"{soft:.1f} times real time"


def _factor(run: Callable[[], Result], span: tuple[float, float], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return (span[1] - span[0]) / median(times)


def _four_flywheels(repeats: int) -> Iterator[Line]:
    for viscous in (0.0, VISCOUS, 5 * VISCOUS):
        scene = four_flywheels(viscous=viscous)
        hard, soft = (simulate(s, BENCHMARK_SPAN) for s in (scene, scene.regularized(PRE_SLIP)))
        title = f"viscous {viscous:g} N m s/rad" if viscous else "no viscous friction"
        agree = _yes(sorted(_changes(hard)) == sorted(_changes(soft)))
        yield f"{title}: events, same mode changes with pre-slip", f"{len(hard.events)}, {agree}"
        stops = [e.t for e in hard.events if e.contact == "brake" and e.after == 0]
        slowest = float(hard.velocity("w1").min())
        yield "  first wheel", f"stops at {stops[0]:.6f} s" if stops else f"slows to {slowest:.3f} rad/s"
        difference = _error(soft, hard, BENCHMARK_SPAN)
        yield "  largest difference of velocities to pre-slip", f"{difference / PRE_SLIP:.2f} v_pre"


def _relaxation(repeats: int) -> Iterator[Line]:
    law = DryFriction(mu_static=0.5, mu_coulomb=0.0)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Damper("a", GROUND, damping=3.0),
        Contact("c", "a", GROUND, law, normal=10.0),
        Force("a", piecewise_linear([20.0, 30.0], [0.0, 10.0])),
    )
    result = simulate(scene, (0.0, 30.0))
    for event in result.events:
        yield f"v = exp(-3 t), then a load up to 5 N: {event.cause}", f"{event.t:.3f} s"
    relaxed = result.events[0]
    last = float(result.y[0][result.t < relaxed.t][-1])
    yield (
        "velocity at the last point before it is found",
        f"{last:.1e} m/s, exp(-3 t) {math.exp(-3 * relaxed.t):.1e}",
    )
    missed = simulate(scene, (0.0, 15.0), velocity_margin=0.0, atol=1e-200)
    yield "zero crossings found without the check, to 15 s", str(len(missed.events))


def _momentum(repeats: int) -> Iterator[Line]:
    result = simulate(flywheel_benchmark(), (0.0, 0.2), t_eval=np.linspace(0.01, 0.2, 500))
    stuck = np.all(result.mode("interface") == 0) and np.all(result.relative_velocity("interface") == 0)
    v = result.velocity("wheel1")
    yield "first brake action: the interface sticks throughout, without slip", _yes(bool(stuck))
    yield "  while the momentum of wheel 1 falls", f"from {v[0]:.4f} to {v[-1]:.4f} N m s"
    try:
        law = Karnopp(DryFriction(0.2, 0.1), PRE_SLIP)
        simulate(flywheel_benchmark().replace("interface", law=law), SETTLED)
    except ValueError as error:
        yield "Karnopp's model between two moving bodies is refused", str(error)


def _changes(result: Result) -> list[tuple[str, int, int]]:
    return [(e.contact, int(e.before), int(e.after)) for e in result.events]


def _error(result: Result, exact: Result, span: tuple[float, float]) -> float:
    times = np.linspace(*span, 2000)
    return float(np.abs(result(times) - exact(times)).max())


def _in_turn(first: Callable[[], Result], second: Callable[[], Result], repeats: int) -> tuple[Result, Result, float]:
    """Run two simulations in turn; return both results and how many times the second takes the first's time."""
    results, times = [first(), second()], ([], [])  # type: tuple[list[Result], tuple[list[float], list[float]]]
    for _ in range(repeats):
        for k, run in enumerate((first, second)):
            start = time.perf_counter()
            results[k] = run()
            times[k].append(time.perf_counter() - start)
    return results[0], results[1], median(times[1]) / median(times[0])


def _yes(value: bool) -> str:
    return "yes" if value else "NO"


CLAIMS: dict[str, tuple[str, Callable[[int], Iterator[Line]]]] = {
    "identical": (
        '"The model allowing pre-slip velocity gives virtually identical results" (section 8)',
        _virtually_identical,
    ),
    "fixed-step": (
        '"in case fixed-step integration routines are used, the new model performs about ten times faster"',
        _fixed_steps,
    ),
    "bdf": ('"in case variable step integration is used not much computation time is gained"', _bdf),
    "stiff": (
        'A pre-slip velocity "may result in a numerically stiff set of differential equations" (6.1)',
        _stiff,
    ),
    "real-time": (
        '"about ten times real-time, with the exception of the RK4 method for the model with pre-slip"',
        _real_time,
    ),
    "four": ("Four flywheels, and viscous friction added, run at once (figs. 9 to 12)", _four_flywheels),
    "relaxation": (
        '"relaxation behavior [...] without changing sign will not be detected" by crossings',
        _relaxation,
    ),
    "momentum": ('"the momentum state cannot be used for keeping track of the slip-stick mode"', _momentum),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the claims and what is measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.claims", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--only", nargs="+", choices=[*CLAIMS], help="claims to measure (default: all)")
    parser.add_argument("--repeats", type=int, default=5, help="runs whose median counts as a time (default: 5)")
    given = parser.parse_args(arguments)
    for key in given.only or CLAIMS:
        claim, measure = CLAIMS[key]
        print(f"\n{claim}\n    python -m benchmarks.claims --only {key}")
        for what, value in measure(given.repeats):
            print(f"  {what:<{_WIDTH}} {value}")


if __name__ == "__main__":
    main()
