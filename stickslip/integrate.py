"""`simulate`: advance to the next event, settle the modes, repeat."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip import arguments
from stickslip.assembly import System
from stickslip.endings import at_limit, jumped, regained, relaxed, turned_over
from stickslip.engine import Engine
from stickslip.engine_ida import OF_FORCES, MultiplierEngine
from stickslip.fixed_step import FixedStepEngine
from stickslip.joining import simulate_apart
from stickslip.mode_set import FREE
from stickslip.modes import Mode
from stickslip.recorder import Recorder
from stickslip.result import Result, SimulationError, SimulationInterrupted
from stickslip.scales import tolerances
from stickslip.scene import Body, Drive, Scene
from stickslip.solving import LOOK_AT_SCENE, Interrupted, Reached, SolverFailure
from stickslip.transitions import Inconsistent, Settled, carry_on, change_one, settle

__all__ = ["simulate"]

_METHODS = ("BDF", "Adams", *arguments.FIXED)
_FORMULATIONS = ("contact-force", "merged", "multiplier")
_IDLE_RESTARTS = 100
_HITS_BETWEEN_LOOKS, _HITS_AT_MOST = 500, 1e9


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
    and (5)-(9); CVODE integrates it and finds the roots of ``w`` for slipping and ``B -+ lambda`` for stuck contacts.

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
        Step in s of the fixed-step methods. One too long for the fastest decay in the scene ends in an error that
        names the longest; with Euler's method oscillations grow by ``exp(step omega^2 t / 2)``.
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
    SimulationInterrupted
        On Ctrl-C, with the same.
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
        raise ValueError(
            f"simulate: IDA, which solves the multiplier formulation, is a BDF method, not {method!r}"
        )
    arguments.check_dead_bands(scene)
    arguments.check_bristles(scene, start, stop)
    system = System.of(scene).over(start, stop, stepped=step is not None)
    if system.parts:

        def run(part: Scene, until: float) -> Result:
            return simulate(
                part,
                (start, until),
                formulation=formulation,
                method=method,
                step=step,
                rtol=rtol,
                atol=atol,
                t_eval=None if outputs is None else outputs[outputs <= until],
                velocity_margin=velocity_margin,
                max_step=max_step,
                dense_output=dense_output,
                progress=progress,
            )

        return simulate_apart(system, run, outputs is not None)
    wanted = tolerances(system, start, stop, rtol, atol, margin, method)
    system.quiet = wanted.quiet
    if formulation == "multiplier":
        system.blur = OF_FORCES * wanted.rtol
    engine: Engine
    if step is not None:
        engine = FixedStepEngine(system, method, step)
    elif formulation == "multiplier":
        engine = MultiplierEngine(system, method, wanted.rtol, wanted.atol, max_step)
    else:
        merged = formulation == "merged"
        engine = Engine(system, method, wanted.rtol, wanted.atol, max_step, merged)
    recorder = Recorder(system, outputs, dense_output, stop)
    return _Run(system, engine, (start, stop), recorder, wanted.margin).to_end(progress)


class _Run:
    """One simulation under way."""

    def __init__(
        self, system: System, engine: Engine, span: tuple[float, float], recorder: Recorder, margin: float
    ) -> None:
        self._system, self._engine, self._margin, self._recorder = system, engine, margin, recorder
        self._start, self._stop = span
        self._t = self._start
        self._restarts, self._idle, self._guards = 0, 0, 0
        self._hits, self._looked_at = 0, self._start
        self._relaxed: list[int] = []
        self._regained: list[int] = []
        self._now: Settled

    def to_end(self, progress: bool) -> Result:
        """Advance, locate, settle, repeat."""
        bar = _bar(self._stop - self._start) if progress else None
        if bar is not None:
            self._engine.show = lambda tau: _advance_bar(bar, self._t + tau - self._start)
        try:
            with self._engine.interruption as interruption:
                self._begin()
                while self._t < self._stop:
                    reached, stop = self._advance()
                    self._recorder.keep(self._now.segment, self._now.modes, reached, stop)
                    self._go_on(reached, stop)
                    if bar is not None:
                        _advance_bar(bar, self._t - self._start)
                    if interruption.pressed:
                        raise KeyboardInterrupt
            self._engine.release()
        except SolverFailure as failure:
            raise self._error(failure.sentence, failure.remedy, failure) from failure.__cause__ or failure
        except Inconsistent as conflict:
            names = ", ".join(repr(self._system.scene.contacts[j].name) for j in conflict.contacts[:10])
            message = f"no consistent modes for the contacts {names}"
            raise self._error(
                message, "their laws contradict each other: look at their coefficients"
            ) from conflict
        except (ArithmeticError, ValueError) as fault:
            raise self._error(str(fault), LOOK_AT_SCENE) from fault
        except KeyboardInterrupt as interruption:
            t = self._t
            if isinstance(interruption, Interrupted):
                t = self._keep_unfinished(interruption.reached)
            message = f"interrupted at t = {t:.9g} s"
            raise SimulationInterrupted(message, self._result(message, -1)) from None
        finally:
            if bar is not None:
                bar.close()
        return self._result("the end of the time span was reached", 0)

    # -- the loop -----------------------------------------------------------------------------------------

    def _begin(self) -> None:
        system = self._system
        places: tuple[Body | Drive, ...] = (*system.scene.bodies, *system.scene.drives)
        y = np.zeros(system.size)
        y[: system.n] = [body.velocity for body in system.scene.bodies]
        y[system.n : system.first_bristle] = [places[i].position for i in system.placed]
        since = self._start - np.array([c.rested for c in system.scene.contacts])
        nothing = np.zeros(system.m, dtype=bool)
        stop = system.loads.next_break(self._start, self._stop)
        self._now = settle(system, self._start, y, None, since, nothing, nothing, stop)

    def _advance(self) -> tuple[Reached, float]:
        """Follow the segment; return its computed points and the time at which it ends."""
        segment = self._now.segment
        self._guards = max(self._guards, segment.armed)
        reached, self._relaxed = relaxed(segment, self._follow(segment.horizon), self._margin)
        regains = regained(segment, reached)
        self._regained = []
        if regains is not None:
            reached, self._regained = self._follow(regains[0]), [regains[1]]
        tau = float(reached.taus[-1])
        if not (reached.hit or self._relaxed or self._regained) and tau >= segment.horizon:
            # the break itself: what was added up to it has been rounded
            return reached, self._system.loads.next_break(segment.t, self._stop)
        return reached, segment.t + tau

    def _follow(self, horizon: float) -> Reached:
        segment = self._now.segment
        reached = self._engine.advance(segment, horizon)
        if not reached.joined:
            segment.exact_velocities(reached.taus, reached.states)
        return reached

    def _go_on(self, reached: Reached, t: float) -> None:
        """Settle the modes at `t`, the end of the segment, and start the next one."""
        segment, system = self._now.segment, self._system
        self._watch_progress(t, reached.hit)
        before, turns = turned_over(segment, reached, self._now.modes)
        for turn in turns:
            self._recorder.note(*turn, segment, fired=False, relaxed=False)
        if t >= self._stop:
            return
        self._restarts += 1
        y, stop, tau = reached.states[-1], system.loads.next_break(t, self._stop), float(reached.taus[-1])
        parted = jumped(segment, tau, t)
        jumps = system.drives > 0 and parted.any()
        changed = self._relaxed or self._regained or jumps or before is not self._now.modes
        if not (reached.hit or changed):
            unchanged = carry_on(system, t, y, self._now, stop)
            if unchanged is not None:
                self._now = unchanged
                return
        if reached.hit and not changed and tau < segment.horizon:
            found = change_one(system, t, tau, y, self._now, stop)
            if found is not None:
                self._now, j = found
                self._note(t, j, int(before[j]), fired=True)
                return
        touching, fired = at_limit(segment, reached, self._relaxed)
        fired[self._regained] = True
        # what is called at rest is, but for what the solver's errors leave of it
        touching |= (before == 0) & ~parted
        since = np.where(before == 0, self._now.since, t)
        self._now = settle(system, t, y, before, since, touching, fired, stop, segment.y, self._idle)
        self._note_changes(t, before, fired)

    def _note_changes(self, t: float, before: NDArray[np.int8], fired: NDArray[np.bool_]) -> None:
        now = self._now
        changed = (now.modes != before) & (now.segment.mode_set.modes != FREE)
        for j in np.flatnonzero(changed).tolist():
            self._note(t, j, int(before[j]), bool(fired[j]))

    def _note(self, t: float, j: int, before: int, fired: bool) -> None:
        after, segment = int(self._now.modes[j]), self._now.segment
        self._recorder.note(t, j, before, after, segment, fired, j in self._relaxed)

    def _watch_progress(self, t: float, hit: bool) -> None:
        """Go on to `t`; give up where time stands still, or goes on so slowly that 1e9 events would be needed."""
        whole = self._stop - self._start
        stands = t - self._t <= 1e-14 * whole
        self._t = t
        self._idle = self._idle + 1 if stands else 0
        if self._idle > _IDLE_RESTARTS + 10 * self._system.m:
            raise ArithmeticError(f"modes flip without progress in time: contacts {self._recent()}")
        self._hits += hit
        if self._hits >= _HITS_BETWEEN_LOOKS * max(self._system.m, 1):
            if (t - self._looked_at) * _HITS_AT_MOST < self._hits * whole:
                raise ArithmeticError(
                    f"modes flip with hardly any progress in time: contacts {self._recent()}"
                )
            self._hits, self._looked_at = 0, t

    def _recent(self) -> str:
        return ", ".join(map(repr, sorted({event.contact for event in self._recorder.events[-20:]})))

    # -- how it ends --------------------------------------------------------------------------------------

    def _result(self, message: str, status: int) -> Result:
        work = self._engine.work
        stats = {
            "states": self._system.size,
            "fewest_states": int(min(work.fewest_states, self._system.size)),
            "guards": self._guards,
            "restarts": self._restarts,
            "steps": work.steps,
            "rate_calls": work.rate_calls,
            "jacobian_calls": work.jacobian_calls,
            "guard_calls": work.guard_calls,
            "solvers": work.solvers,
        }
        return self._recorder.result(message, status, stats)

    def _keep_unfinished(self, reached: Reached) -> float:
        """Keep the points of a segment that has come to no end; return the time of the last."""
        segment = self._now.segment
        segment.exact_velocities(reached.taus, reached.states)
        t = float(segment.t + reached.taus[-1])
        self._recorder.keep(segment, self._now.modes, reached, t)
        return t

    def _error(self, message: str, remedy: str, failure: SolverFailure | None = None) -> SimulationError:
        t, modes = self._t, {}
        if hasattr(self, "_now"):
            labels = self._now.modes
            modes = {c.name: Mode(int(k)) for c, k in zip(self._system.scene.contacts, labels, strict=True)}
            if failure is not None and failure.reached is not None:
                t = self._keep_unfinished(failure.reached)
        listed = ", ".join(f"{name} {mode.name}" for name, mode in list(modes.items())[:10])
        text = f"at t = {t:.9g} s: {message}; modes: {listed or 'not settled yet'}; {remedy}"
        return SimulationError(text, t, modes, self._result(text, -1))


def _advance_bar(bar: Any, t: float) -> None:
    bar.update(max(t - bar.n, 0.0))


def _bar(span: float) -> Any:
    from tqdm import tqdm

    return tqdm(
        total=span, unit="s", desc="simulated", bar_format="{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}]"
    )
