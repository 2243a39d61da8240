"""The two-flywheel benchmark at 1000 outputs: `stickslip` beside scripts written by hand for this one scene.

    python -m benchmarks.peers [--repeats 21]

Each script is what a competent user would write: one smooth phase after another between load breaks and
events, with analytic rates and guards, plain floats in the callbacks and the exact Jacobian for the implicit
methods. It runs at the loosest tolerance at which velocities and event times are right to 2e-7. The scripts
take turns with `simulate` (A B A B ...), so that a noisy machine hits both alike.
"""

from __future__ import annotations

import argparse
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import pairwise
from math import exp
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip import Scene, simulate
from stickslip.benchmark import BENCHMARK_SPAN, flywheel_benchmark
from validation.analytic import two_flywheels

Array = NDArray[np.float64]

OUTPUTS = np.linspace(*BENCHMARK_SPAN, 1000)
ALLOWED = 2e-7
TOLERANCES = tuple(10.0 ** (-k / 2) for k in range(4, 23))

# -- the scene by hand: table 1 of Breedveld (2000) -----------------------------------------------------

INERTIA1, INERTIA2 = 1.0, 10.0
MU_S, MU_C, DWELL = 0.2, 0.1, 0.1
NORMAL = 100.0
BRAKE_TIMES = (0.05, 0.10, 0.15, 0.4, 0.5, 0.6)
BRAKE_FORCES = (0.0, 150.0, 0.0, 0.0, 300.0, 0.0)
INTERFACE, BRAKE = 0, 1


@dataclass
class Answer:
    """Velocities of both wheels at the outputs, events (time, contact, mode), and the work done."""

    velocities: Array
    events: list[tuple[float, int, int]]
    steps: int = 0
    nfev: int = 0


@dataclass
class Phase:
    """One smooth phase: the modes of both contacts, and the brake's normal force ``n0 + n1 (t - t0)``."""

    t0: float
    t1: float
    n0: float
    n1: float
    modes: list[int]
    since: list[float]
    v: list[float] = field(default_factory=list)

    def normal(self, t: float) -> float:
        """Return the normal force of the brake."""
        return self.n0 + self.n1 * (t - self.t0)

    def rates(self) -> tuple[float, float, float, float]:
        """Return accelerations and their slopes: ``a + s (t - t0)`` for either wheel."""
        interface, brake = self.modes
        r, b0, b1 = interface * MU_C * NORMAL, brake * MU_C * self.n0, brake * MU_C * self.n1
        if interface and brake:
            return (-r - b0) / INERTIA1, -b1 / INERTIA1, r / INERTIA2, 0.0
        if brake:
            both = INERTIA1 + INERTIA2
            return -b0 / both, -b1 / both, -b0 / both, -b1 / both
        return 0.0, 0.0, r / INERTIA2, 0.0

    def load(self, contact: int, t: float) -> float:
        """Return the force that a stuck contact carries, eq. (1)."""
        if contact == INTERFACE:
            return -self.modes[BRAKE] * MU_C * self.normal(t) * INERTIA2 / (INERTIA1 + INERTIA2)
        return -self.modes[INTERFACE] * MU_C * NORMAL

    def guards(self) -> tuple[list[int], Callable[[float, float, float], list[float]]]:
        """Return the contact of each guard, and the guards: positive now, zero at the event."""
        interface, brake = self.modes
        t0, n0, n1, (since_i, since_b) = self.t0, self.n0, self.n1, self.since
        share = -brake * MU_C * INERTIA2 / (INERTIA1 + INERTIA2)
        drag = -interface * MU_C * NORMAL

        def both_slip(t: float, v1: float, v2: float) -> list[float]:
            return [interface * (v1 - v2), brake * v1]

        def interface_stuck(t: float, v1: float, v2: float) -> list[float]:
            level = NORMAL * (MU_S - (MU_S - MU_C) * exp((since_i - t) / DWELL))
            load = share * (n0 + n1 * (t - t0))
            return [level - load, level + load, brake * v1]

        def brake_stuck(t: float, v1: float, v2: float) -> list[float]:
            level = (n0 + n1 * (t - t0)) * (MU_S - (MU_S - MU_C) * exp((since_b - t) / DWELL))
            return [interface * (v1 - v2), level - drag, level + drag]

        if interface and brake:
            return [INTERFACE, BRAKE], both_slip
        if brake:
            return [INTERFACE, INTERFACE, BRAKE], interface_stuck
        return [INTERFACE, BRAKE, BRAKE], brake_stuck

    def settle(self, t: float, contact: int, v: list[float]) -> int:
        """Change the mode of the contact whose guard is 0 at `t`; return its new mode."""
        if self.modes[contact]:
            if contact == INTERFACE:
                v[:] = [(INERTIA1 * v[0] + INERTIA2 * v[1]) / (INERTIA1 + INERTIA2)] * 2
            else:
                v[0] = 0.0
            self.since[contact] = t
            load = self.load(contact, t)
            level = MU_C * (NORMAL if contact == INTERFACE else self.normal(t))
            self.modes[contact] = 0 if abs(load) <= level else (1 if load > 0 else -1)
        else:
            self.modes[contact] = 1 if self.load(contact, t) > 0 else -1
        return self.modes[contact]


# what a solver returns for a phase: the time and state at its end, the guard that ended it (or None), the
# velocities at the outputs in [t0, t), steps and rate calls
Ended = tuple[float, list[float], int | None, Array, int, int]
Solve = Callable[[Phase, Array], Ended]


def march(solve: Solve) -> Answer:
    """Go from phase to phase; `solve` does the work of one solver."""
    found, events, steps, nfev, done = [], [], 0, 0, 0
    t, v, modes, since = 0.0, [1.0, 1.01], [-1, 1], [0.0, 0.0]
    edges = (BENCHMARK_SPAN[0], *BRAKE_TIMES, BENCHMARK_SPAN[1])
    forces = (0.0, *BRAKE_FORCES, 0.0)
    for (start, stop), (before, after) in zip(pairwise(edges), pairwise(forces), strict=True):
        slope = (after - before) / (stop - start)
        while t < stop:
            phase = Phase(t, stop, before + slope * (t - start), slope, modes, since, v)
            last = int(np.searchsorted(OUTPUTS, stop, side="right" if stop == edges[-1] else "left"))
            t, v, guard, at, n, calls = solve(phase, OUTPUTS[done:last])
            done += len(at)
            found.append(at)
            steps, nfev = steps + n, nfev + calls
            if guard is not None:
                contact = phase.guards()[0][guard]
                events.append((t, contact, phase.settle(t, contact, v)))
            elif not modes[INTERFACE]:
                v = [v[0], v[0]]
    return Answer(np.concatenate(found), events, steps, nfev)


# -- scikit-sundae --------------------------------------------------------------------------------------


def sundae(method: str, rtol: float, *, at_outputs: bool) -> Answer:
    """A fresh CVODE for each phase: two-point `solve` and Hermite outputs, or `solve` at the outputs."""
    from sksundae.cvode import CVODE

    def solve(phase: Phase, outputs: Array) -> Ended:
        a1, s1, a2, s2 = phase.rates()
        t0, (contacts, guards) = phase.t0, phase.guards()

        def rate(t: float, y: Array, out: Array) -> None:
            out[0] = a1 + s1 * (t - t0)
            out[1] = a2 + s2 * (t - t0)

        def jacobian(t: float, y: Array, yp: Array, out: Array) -> None:
            out[:] = 0.0

        def events(t: float, y: Array, out: Array) -> None:
            out[:] = guards(t, *y.tolist())

        solver = CVODE(
            rate,
            eventsfn=events,
            num_events=len(contacts),
            jacfn=jacobian,
            method=method,
            rtol=rtol,
            atol=rtol,
        )
        times = np.unique(np.concatenate([[t0], outputs, [phase.t1]])) if at_outputs else np.array([t0, phase.t1])
        found = solver.solve(times, np.array(phase.v))
        if found.status < 0:
            raise RuntimeError(found.message)
        t, y = found.t, found.y
        guard = int(np.flatnonzero(found.i_events[-1])[0]) if found.status == 2 else None
        wanted = outputs[: int(np.searchsorted(outputs, t[-1]))] if guard is not None else outputs
        if at_outputs:
            at = y[np.searchsorted(t, wanted)]
        else:
            slopes = np.stack([a1 + s1 * (t - t0), a2 + s2 * (t - t0)], axis=1)
            at = hermite(t, y, slopes[:-1], slopes[1:], wanted)
        steps = 0 if at_outputs else len(t) - 1  # the number of its own steps is not known
        return float(t[-1]), y[-1].tolist(), guard, at, steps, found.nfev

    return march(solve)


def hermite(t: Array, y: Array, left: Array, right: Array, at: Array) -> Array:
    """Return the cubics through values and slopes at both ends of each step, at times inside."""
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    h = (t[k + 1] - t[k])[:, None]
    x = (at - t[k])[:, None] / h
    rise = y[k + 1] - y[k]
    bend = (1 - x) * (h * left[k] - rise) + x * (rise - h * right[k])
    return y[k] + x * rise + x * (1 - x) * bend


# -- scipy ----------------------------------------------------------------------------------------------


def scipy(method: str, rtol: float) -> Answer:
    """`solve_ivp` for each phase, with terminal events."""
    from scipy.integrate import solve_ivp

    zero = np.zeros((2, 2))

    def solve(phase: Phase, outputs: Array) -> Ended:
        a1, s1, a2, s2 = phase.rates()
        t0, (contacts, guards) = phase.t0, phase.guards()

        def rate(t: float, y: Array) -> list[float]:
            return [a1 + s1 * (t - t0), a2 + s2 * (t - t0)]

        def event(k: int) -> Callable[[float, Array], float]:
            def guard(t: float, y: Array) -> float:
                return guards(t, y[0], y[1])[k]

            guard.terminal, guard.direction = True, -1  # type: ignore[attr-defined]
            return guard

        found = solve_ivp(
            rate,
            (t0, phase.t1),
            phase.v,
            method=method,
            t_eval=np.unique(np.append(outputs, phase.t1)),
            events=[event(k) for k in range(len(contacts))],
            rtol=rtol,
            atol=rtol,
            **({} if method == "LSODA" else {"jac": zero}),
        )
        if found.status < 0:
            raise RuntimeError(found.message)
        guard = next((k for k, times in enumerate(found.t_events) if len(times)), None)
        if guard is None:
            return phase.t1, found.y[:, -1].tolist(), None, found.y.T[: len(outputs)], 0, found.nfev
        t, v = float(found.t_events[guard][0]), found.y_events[guard][0].tolist()
        return t, v, guard, found.y.T[: int(np.searchsorted(outputs, t))], 0, found.nfev

    return march(solve)


# -- PathSim --------------------------------------------------------------------------------------------


def pathsim(rtol: float, *, at_outputs: bool) -> Answer:
    """One ODE block, zero-crossing events for the contacts and scheduled ones for the load breaks."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import ODE, Scope
    from pathsim.events import ScheduleList, ZeroCrossingDown
    from pathsim.solvers import RKBS32

    forces = (0.0, *BRAKE_FORCES, 0.0)
    edges = (BENCHMARK_SPAN[0], *BRAKE_TIMES, BENCHMARK_SPAN[1])
    slopes = (np.diff(forces) / np.diff(edges)).tolist()
    events: list[tuple[float, int, int]] = []
    phases: list[Phase] = []
    now: dict[str, Any] = {"calls": 0}

    def enter(phase: Phase) -> None:
        phases.append(phase)
        now["contacts"], now["guards"] = phase.guards()
        now["rates"] = phase.rates()

    def load_break(t: float) -> None:
        k, old = edges.index(t), phases[-1]
        enter(Phase(t, edges[k + 1], forces[k], slopes[k], old.modes.copy(), old.since.copy()))

    def rate(x: Array, u: Array, t: float) -> Array:
        now["calls"] += 1
        a1, s1, a2, s2 = now["rates"]
        tau = t - phases[-1].t0
        return np.array([a1 + s1 * tau, a2 + s2 * tau])

    def guard(k: int) -> Callable[[float], float]:
        return lambda t: now["guards"](t, *wheels.engine.get().tolist())[k] if k < len(now["contacts"]) else 1.0

    def event(k: int) -> Callable[[float], None]:
        def settle(t: float) -> None:
            old, contact, v = phases[-1], now["contacts"][k], wheels.engine.get().tolist()
            new = Phase(t, old.t1, old.normal(t), old.n1, old.modes.copy(), old.since.copy())
            events.append((t, contact, new.settle(t, contact, v)))
            wheels.engine.set(np.array(v))
            enter(new)

        return settle

    enter(Phase(0.0, edges[1], 0.0, 0.0, [-1, 1], [0.0, 0.0]))
    wheels = ODE(rate, np.array([1.0, 1.01]))
    scope = Scope(sampling_period=float(OUTPUTS[1]) if at_outputs else None)
    crossings = [ZeroCrossingDown(guard(k), event(k), tolerance=0.01 * rtol) for k in range(3)]
    Simulation(
        [wheels, scope],
        [Connection(wheels[:2], scope[:2])],
        [ScheduleList(list(BRAKE_TIMES), load_break), *crossings],
        dt=0.01,
        Solver=RKBS32,
        tolerance_lte_rel=rtol,
        tolerance_lte_abs=rtol,
        log=False,
    ).run(BENCHMARK_SPAN[1])
    t, recorded = scope.read()
    y = np.asarray(recorded).T
    if at_outputs:
        return Answer(y[: len(OUTPUTS)], events, len(t), now["calls"])
    within = np.searchsorted([phase.t0 for phase in phases], (t[1:] + t[:-1]) / 2) - 1
    starts = np.array([phase.t0 for phase in phases])[within]
    a1, s1, a2, s2 = np.array([phase.rates() for phase in phases])[within].T
    left, right = (np.stack([a1 + s1 * (ends - starts), a2 + s2 * (ends - starts)], axis=1) for ends in (t[:-1], t[1:]))
    return Answer(hermite(t, y, left, right, OUTPUTS), events, len(t) - 1, now["calls"])


# -- the comparison -------------------------------------------------------------------------------------

PEERS: dict[str, Callable[[float], Answer]] = {
    "sksundae Adams, steps + Hermite": lambda rtol: sundae("Adams", rtol, at_outputs=False),
    "sksundae BDF, steps + Hermite": lambda rtol: sundae("BDF", rtol, at_outputs=False),
    "sksundae Adams, at outputs": lambda rtol: sundae("Adams", rtol, at_outputs=True),
    "sksundae BDF, at outputs": lambda rtol: sundae("BDF", rtol, at_outputs=True),
    "scipy LSODA": lambda rtol: scipy("LSODA", rtol),
    "scipy Radau": lambda rtol: scipy("Radau", rtol),
    "scipy BDF": lambda rtol: scipy("BDF", rtol),
    "PathSim RKBS32, sampled by Scope": lambda rtol: pathsim(rtol, at_outputs=True),
    "PathSim RKBS32, steps + Hermite": lambda rtol: pathsim(rtol, at_outputs=False),
    "stickslip.simulate, scene built anew": lambda rtol: ours(flywheel_benchmark()),
}
TARGETS = {
    "no slower than 1.1 times the best scikit-sundae script": (("sksundae",), 1 / 1.1),
    "3 times faster than scipy Radau": (("scipy Radau",), 3.0),
    "5 times faster than scipy BDF": (("scipy BDF",), 5.0),
    "20 times faster than PathSim at its own outputs": (("PathSim RKBS32, sampled",), 20.0),
}


@dataclass(frozen=True)
class Row:
    """A script at the loosest tolerance at which its errors are within `ALLOWED`."""

    name: str
    rtol: float
    answer: Answer
    error: float
    event_error: float
    median: float
    ratio: float


class Exact:
    """The exact answer, to judge others by."""

    def __init__(self) -> None:
        """Compute it, with 40 digits."""
        motion = two_flywheels()
        self.velocities = np.array([[float(v) for v in motion.velocity(t)] for t in OUTPUTS.tolist()])
        contacts = {"interface": INTERFACE, "brake": BRAKE}
        self.events = [(float(e.time), contacts[e.contact], e.after) for e in motion.events]

    def errors(self, answer: Answer) -> tuple[float, float]:
        """Return the largest errors of velocities and event times, infinite where the story differs."""
        told = [event[1:] for event in answer.events]
        if answer.velocities.shape != self.velocities.shape or told != [event[1:] for event in self.events]:
            return float("inf"), float("inf")
        late = max(abs(a[0] - b[0]) for a, b in zip(answer.events, self.events, strict=True))
        return float(np.abs(answer.velocities - self.velocities).max()), late


SCENE = flywheel_benchmark()


def ours(scene: Scene = SCENE) -> Answer:
    """Return the answer of `simulate` with its defaults."""
    result = simulate(scene, BENCHMARK_SPAN, t_eval=OUTPUTS)
    contacts = {"interface": INTERFACE, "brake": BRAKE}
    events = [(e.t, contacts[e.contact], int(e.after)) for e in result.events]
    velocities = np.stack([result.velocity("wheel1"), result.velocity("wheel2")], axis=1)
    return Answer(velocities, events, result.stats["steps"], result.nfev)


def loosest(script: Callable[[float], Answer], exact: Exact) -> float:
    """Return the loosest tolerance at which the errors of a script are within `ALLOWED`."""
    for rtol in TOLERANCES:
        if max(exact.errors(script(rtol))) <= ALLOWED:
            return rtol
    raise ValueError(f"no tolerance down to {TOLERANCES[-1]:g} gives errors of at most {ALLOWED:g}")


def paired(a: Callable[[], Any], b: Callable[[], Any], repeats: int) -> tuple[list[float], list[float]]:
    """Return the wall times in s of two callables that take turns."""
    times: tuple[list[float], list[float]] = ([], [])
    for turn in range(repeats + 1):
        for run, kept in zip((a, b), times, strict=True):
            start = clock.perf_counter()
            run()
            if turn:
                kept.append(clock.perf_counter() - start)
    return times


def compare(names: Sequence[str], repeats: int) -> list[Row]:
    """Measure the scripts of these names against `simulate`."""
    exact = Exact()
    answer = ours()
    rows, own = [], []
    for name in names:
        script = PEERS[name]
        rtol = loosest(script, exact)
        theirs, mine = paired(lambda script=script, rtol=rtol: script(rtol), ours, repeats)  # type: ignore[misc]
        own += mine
        found = script(rtol)
        ratio = median(a / b for a, b in zip(theirs, mine, strict=True))
        rows.append(Row(name, rtol, found, *exact.errors(found), median(theirs), ratio))
    return [Row("stickslip.simulate", 1e-8, answer, *exact.errors(answer), median(own), 1.0), *rows]


def table(rows: Sequence[Row]) -> str:
    """Return the rows as a Markdown table."""
    titles = (
        "script",
        "rtol",
        "error / (rad/s)",
        "events off by / s",
        "median / ms",
        "ratio",
        "steps",
        "rhs calls",
    )
    lines = ["| " + " | ".join(titles) + " |", "|---" * len(titles) + "|"]
    for row in rows:
        steps = f"{row.answer.steps}" if row.answer.steps else ""
        cells = [row.name, f"{row.rtol:.1e}", f"{row.error:.1e}", f"{row.event_error:.1e}"]
        cells += [f"{1e3 * row.median:.2f}", f"{row.ratio:.2f}", steps, f"{row.answer.nfev}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=21, help="timed turns of each pair (default 21)")
    repeats = parser.parse_args(arguments).repeats
    names = list(PEERS)
    if find_spec("pathsim") is None:
        names = [name for name in names if not name.startswith("PathSim")]
        print("PathSim is not installed and left out: pip install 'stickslip[peers]'\n")
    rows = compare(names, repeats)
    print(f"Benchmark, {len(OUTPUTS)} outputs, errors at most {ALLOWED:g}, medians of {repeats} turns\n")
    print(table(rows), end="\n\n")
    for target, (names_of, wanted) in TARGETS.items():
        ratios = [row.ratio for row in rows if row.name.startswith(names_of)]
        if ratios:
            verdict = "met" if min(ratios) >= wanted else "MISSED"
            print(f"{verdict}: {target} (needs {wanted:.2f}, is {min(ratios):.2f})")


if __name__ == "__main__":
    main()
