"""The two-flywheel benchmark at 1000 outputs: `stickslip` beside scripts written by hand for this one scene.

    python -m validation.peers [--repeats 21]

Each script is what a competent user would write: one smooth segment after another between load breaks and
events, with analytic rates and guards, plain floats in the callbacks and the exact Jacobian where it is asked for. It
runs at the loosest tolerance at which velocities and event times are right to 2e-7. The scripts take turns with
`simulate` (A B A B ...), so that a noisy machine hits both alike.
"""

from __future__ import annotations

import argparse
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import exp
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip import simulate
from stickslip.benchmark import BENCHMARK_SPAN, flywheel_benchmark
from validation.analytic import two_flywheels

Array = NDArray[np.float64]

OUTPUTS = np.linspace(*BENCHMARK_SPAN, 1000)
ALLOWED = 2e-7
TOLERANCES = tuple(10.0**-k for k in range(2, 13))
TARGETS = {"sksundae": 1 / 1.1, "scipy BDF": 5.0, "scipy Radau": 3.0, "PathSim": 20.0}

# -- the scene by hand: table 1 of Breedveld (2000) -----------------------------------------------------------

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
    """One smooth segment: the modes of both contacts, and the brake's normal force ``n0 + n1 (t - t0)``."""

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


# what a solver does with a phase: the time and state at its end, the guard that ended it (or None), the velocities
# at the outputs in [t0, t), steps and rate calls
Ended = tuple[float, list[float], int | None, Array, int, int]
Segment = Callable[[Phase, Array], Ended]


def march(segment: Segment) -> Answer:
    """Go from segment to segment; `segment` does the work of one solver."""
    found, events, steps, nfev, done = [], [], 0, 0, 0
    t, v, modes, since = 0.0, [1.0, 1.01], [-1, 1], [0.0, 0.0]
    edges = (BENCHMARK_SPAN[0], *BRAKE_TIMES, BENCHMARK_SPAN[1])
    forces = (0.0, *BRAKE_FORCES, 0.0)
    for (start, stop), (before, after) in zip(pairwise(edges), pairwise(forces), strict=True):
        slope = (after - before) / (stop - start)
        while t < stop:
            phase = Phase(t, stop, before + slope * (t - start), slope, modes, since, v)
            last = int(np.searchsorted(OUTPUTS, stop, side="right" if stop == edges[-1] else "left"))
            t, v, guard, at, n, calls = segment(phase, OUTPUTS[done:last])
            done += len(at)
            found.append(at)
            steps, nfev = steps + n, nfev + calls
            if guard is not None:
                contact = phase.guards()[0][guard]
                events.append((t, contact, phase.settle(t, contact, v)))
            elif not modes[INTERFACE]:
                v = [v[0], v[0]]
    return Answer(np.concatenate(found), events, steps, nfev)


# -- scikit-sundae ---------------------------------------------------------------------------------------------


def sundae(method: str, rtol: float, *, at_outputs: bool) -> Answer:
    """A fresh CVODE for each segment: two-point `solve` and Hermite outputs, or `solve` at the outputs."""
    from sksundae.cvode import CVODE

    def segment(phase: Phase, outputs: Array) -> Ended:
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
            rate, eventsfn=events, num_events=len(contacts), jacfn=jacobian, method=method, rtol=rtol, atol=rtol
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
        return float(t[-1]), y[-1].tolist(), guard, at, len(t) - 1, found.nfev

    return march(segment)


def hermite(t: Array, y: Array, left: Array, right: Array, at: Array) -> Array:
    """Return the cubics through the values and through the slopes at both ends of each step, at times inside."""
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    h = (t[k + 1] - t[k])[:, None]
    x = (at - t[k])[:, None] / h
    rise = y[k + 1] - y[k]
    bend = (1 - x) * (h * left[k] - rise) + x * (rise - h * right[k])
    return y[k] + x * rise + x * (1 - x) * bend


# -- scipy -------------------------------------------------------------------------------------------------------


def scipy(method: str, rtol: float) -> Answer:
    """`solve_ivp` for each segment, with terminal events."""
    from scipy.integrate import solve_ivp

    zero = np.zeros((2, 2))

    def segment(phase: Phase, outputs: Array) -> Ended:
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

    return march(segment)


# -- PathSim -----------------------------------------------------------------------------------------------------


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
    left, right = (
        np.stack([a1 + s1 * (ends - starts), a2 + s2 * (ends - starts)], axis=1) for ends in (t[:-1], t[1:])
    )
    return Answer(hermite(t, y, left, right, OUTPUTS), events, len(t) - 1, now["calls"])
