"""`simulate`: advance to the next event, settle the modes, repeat."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip import arguments
from stickslip.assembly import System
from stickslip.mode_set import FREE, OPEN
from stickslip.engine import Engine, Reached, SolverFailure
from stickslip.engine_ida import MultiplierEngine
from stickslip.fixed_step import FixedStepEngine
from stickslip.modes import Mode
from stickslip.result import Event, Piece, Result, SimulationError, interpolate
from stickslip.scene import Scene
from stickslip.scales import tolerances
from stickslip.segment import Segment
from stickslip.transitions import Inconsistent, Settled, carry_on, settle

__all__ = ["simulate"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_METHODS = ("BDF", "Adams", *arguments.FIXED)
_FORMULATIONS = ("contact-force", "merged", "multiplier")
_IDLE_RESTARTS = 100


def simulate(
    scene: Scene,
    t_span: Sequence[float],
    *,
    formulation: str = "contact-force",
    method: str = "BDF",
    step: float | None = None,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    t_eval: Iterable[float] | None = None,
    velocity_margin: float | None = None,
    max_step: float = math.inf,
    dense_output: bool = True,
    progress: bool = False,
) -> Result:
    """Simulate a scene with exact sticking and exact events.

    Between events the motion follows ``M v' = F - G^T r`` with the contact forces r of Breedveld (2000), eqs. (1)
    and (5)-(9); CVODE integrates it and finds the roots of ``w`` for slipping and of ``B -+ lambda`` for stuck contacts.

    Parameters
    ----------
    scene : Scene
    t_span : (float, float)
        Start and end in s.
    formulation : str
        "contact-force": static structure, all velocities are states (the paper's final model). "merged": dynamic
        structure, stuck bodies become one inertia and the state shrinks (figs. 4 and 5). "multiplier": the contact
        forces are unknowns of an index-1 DAE (figs. 2 and 3), solved by IDA.
    method : str
        "BDF" or "Adams" (CVODE); "RK4" or "Euler" with fixed steps, mode changes at step ends.
    step : float, optional
        Step in s of the fixed-step methods.
    rtol, atol : float
        Relative and absolute tolerance of the states.
    t_eval : sequence of float, optional
        Times in s of the outputs; without it every computed point is kept and every event twice.
    velocity_margin : float, optional
        Relative velocity below which a contact counts as stuck once its velocities are constant; 0 switches the
        check off. By default a hundred times what the tolerances leave uncertain.
    max_step : float
        Longest step in s.
    dense_output : bool
        Keep what interpolation needs; False keeps only the outputs at `t_eval`.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Result

    Raises
    ------
    ValueError, TypeError
        If an argument is not usable, before anything runs.
    SimulationError
        If the simulation cannot go on; what was computed is in its `result`.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"simulate: scene must be a Scene, got {type(scene).__name__}")
    start, stop = arguments.span(t_span)
    arguments.choice("formulation", formulation, _FORMULATIONS)
    arguments.choice("method", method, _METHODS)
    rtol = arguments.between("rtol", rtol, 1e-14, 0.1)
    atol = arguments.between("atol", atol, 0.0, math.inf)
    max_step = math.inf if max_step == math.inf else arguments.between("max_step", max_step, 0.0, math.inf)
    margin = arguments.margin(velocity_margin)
    outputs = arguments.outputs(t_eval, start, stop, dense_output)
    step = arguments.step_length(method, step, formulation)
    if formulation == "multiplier" and method != "BDF":
        raise ValueError(f"simulate: IDA, which solves the multiplier formulation, is a BDF method, not {method!r}")
    arguments.check_dead_bands(scene)
    system = System.of(scene).over(start, stop, stepped=step is not None)
    wanted = tolerances(system, start, stop, rtol, atol, margin)
    engine: Engine
    if step is not None:
        engine = FixedStepEngine(system, method, step)
    elif formulation == "multiplier":
        engine = MultiplierEngine(system, method, wanted.rtol, wanted.atol, max_step)
    else:
        merged = formulation == "merged"
        engine = Engine(system, method, wanted.rtol, wanted.atol, max_step, merged)
    return _Run(system, engine, start, stop, outputs, dense_output, wanted.margin).to_end(progress)


class _Run:
    """One simulation under way."""

    def __init__(
        self,
        system: System,
        engine: Engine,
        start: float,
        stop: float,
        outputs: Array | None,
        dense: bool,
        margin: float,
    ) -> None:
        self._system, self._engine, self._margin = system, engine, margin
        self._start, self._stop, self._t = start, stop, start
        self._outputs, self._dense = outputs, dense
        self._events: list[Event] = []
        self._pieces: list[Piece] = []
        self._done = 0
        self._sampled: list[Array] = []
        self._sampled_piece: list[NDArray[np.intp]] = []
        self._restarts, self._idle, self._guards = 0, 0, 0
        self._causes: dict[int, str] = {}
        self._now: Settled

    def to_end(self, progress: bool) -> Result:
        """Advance, locate, settle, repeat."""
        bar = _bar(self._stop - self._start) if progress else None
        try:
            self._begin()
            while self._t < self._stop:
                reached, stop = self._advance()
                self._record(reached, stop)
                if bar is not None:
                    bar.update(stop - self._t)
                self._go_on(reached, stop)
        except SolverFailure as failure:
            raise self._error(
                f"{failure.sentence.rstrip('.')} (CVODE status {failure.status})",
                "loosen rtol or atol, or give max_step from the time scale of the loads",
                self._t + failure.tau,
            ) from failure
        except Inconsistent as conflict:
            names = ", ".join(repr(self._system.scene.contacts[j].name) for j in conflict.contacts[:10])
            raise self._error(
                f"no consistent modes for the contacts {names}",
                "their laws contradict each other: look at the coefficients and normal forces",
                self._t,
            ) from conflict
        except (ArithmeticError, ValueError) as fault:
            raise self._error(str(fault), "look at the signals and laws of the scene there", self._t) from fault
        finally:
            if bar is not None:
                bar.close()
        return self._result("the end of the time span was reached", 0)

    # -- the loop -----------------------------------------------------------------------------------------

    def _begin(self) -> None:
        system = self._system
        elements = (*system.scene.bodies, *system.scene.drives)
        y = np.array([body.velocity for body in system.scene.bodies] + [elements[i].position for i in system.placed])
        y = np.concatenate([y, np.zeros(system.size - y.size)])
        since = self._start - np.array([c.rested for c in system.scene.contacts])
        nothing = np.zeros(system.m, dtype=bool)
        stop = system.loads.next_break(self._start, self._stop)
        self._now = settle(system, self._start, y, None, since, nothing, nothing, stop)

    def _advance(self) -> tuple[Reached, float]:
        """Follow the segment; return its computed points and the time at which it ends."""
        segment = self._now.segment
        end = segment.t + segment.horizon
        reached = self._engine.advance(segment, segment.horizon)
        self._guards = max(self._guards, segment.armed)
        segment.exact_velocities(reached.taus, reached.states)
        at_end = not reached.hit and reached.taus[-1] >= segment.horizon
        self._causes = {}
        settled_down = self._relaxed(segment, reached)
        if settled_down is not None:
            reached, at_end = settled_down, False
        return reached, self._break_after(segment) if at_end else float(segment.t + reached.taus[-1])

    def _break_after(self, segment: Segment) -> float:
        return self._system.loads.next_break(segment.t, self._stop)

    def _go_on(self, reached: Reached, t: float) -> None:
        """Settle the modes at `t`, the end of the segment, and start the next one."""
        segment, system = self._now.segment, self._system
        self._watch_progress(t)
        before = self._labels_at(segment, reached)
        self._t = t
        if t >= self._stop:
            return
        self._restarts += 1
        y, stop = reached.states[-1], system.loads.next_break(t, self._stop)
        jumped = self._jumped(segment, float(reached.taus[-1]), t)
        if not (reached.hit or self._causes or jumped.any() or before is not self._now.modes):
            unchanged = carry_on(system, t, y, self._now, stop)
            if unchanged is not None:
                self._now = unchanged
                return
        touching, fired = self._at_limit(segment, reached)
        since = np.where(before == 0, self._now.since, t)
        stuck = np.zeros(system.m, dtype=bool)
        stuck[segment.mode_set.stuck] = True
        touching |= stuck & ~jumped
        self._now = settle(system, t, y, before, since, touching, fired, stop)
        eventful = self._now.segment.mode_set.modes != FREE
        for j in np.flatnonzero((self._now.modes != before) & eventful).tolist():
            self._note(t, j, int(before[j]), int(self._now.modes[j]), bool(fired[j]))

    def _at_limit(self, segment: Segment, reached: Reached) -> tuple[Mask, Mask]:
        """Return the contacts whose relative velocity, and those whose guard, has just come to 0."""
        m = self._system.m
        touching, fired = np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
        for j in self._causes:
            touching[j] = fired[j] = True
        if reached.hit:
            values = segment.guards(float(reached.taus[-1]), reached.states[-1])
            at = np.flatnonzero(values <= max(0.0, float(values.min())))
            fired[segment.guard_contacts[at]] = True
            touching[segment.guard_contacts[at[at < segment.slips]]] = True
        return touching, fired

    def _jumped(self, segment: Segment, tau: float, t: float) -> Mask:
        """Return the contacts to a drive whose velocity jumps at `t`."""
        system = self._system
        if not system.drives:
            return np.zeros(system.m, dtype=bool)
        before, after = segment.inputs(tau), system.loads.complete(t)
        size = np.abs(before) + np.abs(after)
        drives = slice(system.first_drive, system.first_acceleration)
        jump = np.zeros_like(before)
        jump[drives] = np.where(np.abs(after - before) > 1e-12 * size, after - before, 0.0)[drives]
        return system.D @ jump != 0

    def _labels_at(self, segment: Segment, reached: Reached) -> NDArray[np.int8]:
        """Return the modes at the segment's end; contacts that are open may have turned over on the way."""
        labels = self._now.modes
        is_open = segment.mode_set.modes >= OPEN
        if not is_open.any() or not reached.taus[-1] > 0:
            return labels
        w = segment.relative_velocity(reached.taus[1:], reached.states[1:].T)
        w = np.where(segment.mode_set.modes[:, None] == FREE, self._system.sign_of(w), np.sign(w))[is_open]
        labels = labels.copy()
        for j, signs in zip(np.flatnonzero(is_open).tolist(), w, strict=True):
            for k, sign in enumerate(signs.tolist()):
                if sign == labels[j]:
                    continue
                if segment.mode_set.modes[j] == FREE:
                    labels[j] = sign
                elif sign != 0:
                    self._note(self._turn_time(segment, reached, j, k), j, int(labels[j]), int(sign), False)
                    labels[j] = sign
        return labels

    def _turn_time(self, segment: Segment, reached: Reached, j: int, k: int) -> float:
        """Return when an open contact's relative velocity passes 0 between computed points k and k + 1."""
        from scipy.optimize import brentq

        def w(tau: float) -> float:
            taus = np.array([tau])
            states = interpolate(segment, reached.taus, reached.states, taus)
            return float(segment.relative_velocity(taus, states.T)[j, 0])

        left, right = float(reached.taus[k]), float(reached.taus[k + 1])
        if w(left) * w(right) >= 0:
            return segment.t + left
        return segment.t + float(brentq(w, left, right, xtol=1e-15 * max(right, 1e-300), rtol=1e-14))

    def _note(self, t: float, j: int, before: int, after: int, fired: bool) -> None:
        name = self._system.scene.contacts[j].name
        if self._now.segment.mode_set.modes[j] == OPEN:
            cause = "open"
        elif j in self._causes:
            cause = self._causes[j]
        elif before == 0:
            cause = "breakaway" if fired else "breakaway with another event"
        elif after == 0:
            cause = "relative velocity 0" if fired else "stuck with another event"
        else:
            cause = "reversal"
        self._events.append(Event(t, name, Mode(before), Mode(after), cause))

    def _relaxed(self, segment: Segment, reached: Reached) -> Reached | None:
        """Return the points up to the first at which a contact has relaxed to rest without crossing 0."""
        contacts = segment.mode_set.slip
        hard = self._system.hard[contacts]
        if self._margin <= 0 or not hard.any():
            return None
        if segment.quadratic and not segment.comes_near_rest(self._margin, float(reached.taus[-1])):
            return None
        last = reached.taus.size - (1 if reached.hit else 0)
        w = segment.relative_velocity(reached.taus[:last], reached.states[:last].T)[contacts]
        w *= segment.mode_set.sign[:, None]
        near = (w <= self._margin) & (w > 0) & hard[:, None]
        for k in np.flatnonzero(near.any(axis=0)).tolist():
            resting = [
                int(contacts[row])
                for row in np.flatnonzero(near[:, k]).tolist()
                if segment.has_come_to_rest(float(reached.taus[k]), reached.states[k], row)
            ]
            if resting:
                self._causes = dict.fromkeys(resting, "relaxation")
                return reached.until(k + 1)
        return None

    def _watch_progress(self, t: float) -> None:
        span = self._stop - self._start
        self._idle = self._idle + 1 if t - self._t <= 1e-14 * span else 0
        if self._idle > _IDLE_RESTARTS + 10 * self._system.m:
            recent = sorted({event.contact for event in self._events[-20:]})
            raise ArithmeticError(f"modes flip without progress in time: contacts {', '.join(map(repr, recent))}")

    # -- what is kept -------------------------------------------------------------------------------------

    def _record(self, reached: Reached, stop: float) -> None:
        segment, labels = self._now.segment, self._now.modes
        number = len(self._pieces)
        taus, states = reached.taus, reached.states
        if self._outputs is not None:
            side = "right" if stop >= self._stop else "left"
            until = int(np.searchsorted(self._outputs, stop, side=side))
            wanted = self._outputs[self._done : until] - segment.t
            self._done = until
            if wanted.size:
                wanted = np.minimum(wanted, taus[-1])
                found = interpolate(segment, taus, states, wanted)
                self._sampled.append(found)
                self._sampled_piece.append(np.full(wanted.size, number))
            if not self._dense:
                if not wanted.size:
                    return
                self._pieces.append(Piece.of(segment, stop, labels, wanted, found, complete=False))
                return
        self._pieces.append(Piece.of(segment, stop, labels, taus, states, multipliers=reached.multipliers))

    def _result(self, message: str, status: int) -> Result:
        system, pieces = self._system, self._pieces
        if self._outputs is not None:
            t = self._outputs[: self._done]
            y = np.concatenate(self._sampled) if self._sampled else np.empty((0, system.size))
            piece_of = np.concatenate(self._sampled_piece) if self._sampled else np.empty(0, dtype=np.intp)
        else:
            t = np.concatenate([_global(piece) for piece in pieces]) if pieces else np.empty(0)
            y = np.concatenate([piece.states for piece in pieces]) if pieces else np.empty((0, system.size))
            piece_of = np.repeat(np.arange(len(pieces)), [piece.taus.size for piece in pieces])
        stats = self._stats()
        return Result(
            system.scene, t, y.T, sorted(self._events, key=lambda event: event.t), status == 0, status, message, stats, system, pieces, piece_of
        )

    def _stats(self) -> dict[str, Any]:
        work = self._engine.work
        return {
            "states": self._system.size,
            "guards": self._guards,
            "restarts": self._restarts,
            "events": len(self._events),
            "steps": work.steps,
            "rate_calls": work.rate_calls,
            "jacobian_calls": work.jacobian_calls,
            "guard_calls": work.guard_calls,
            "solvers": work.solvers,
        }

    def _error(self, message: str, remedy: str, t: float) -> SimulationError:
        labels = self._now.modes if hasattr(self, "_now") else np.empty(0)
        contacts = self._system.scene.contacts
        modes = {c.name: Mode(int(k)) for c, k in zip(contacts, labels, strict=False)}
        listed = ", ".join(f"{name} {mode.name}" for name, mode in list(modes.items())[:10])
        text = f"at t = {t:.9g} s: {message}; modes: {listed or 'not settled yet'}; {remedy}"
        return SimulationError(text, t, modes, self._result(text, -1))


def _global(piece: Piece) -> Array:
    t = piece.start + piece.taus
    t[-1] = piece.stop
    return t


def _bar(span: float) -> Any:
    from tqdm import tqdm

    return tqdm(total=span, unit="s", desc="simulated", bar_format="{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}]")
