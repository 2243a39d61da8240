"""`simulate`: check the arguments, choose an engine, run, and keep what was computed whatever happens."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from typing import Any, get_args

from stickslip.engines import METHODS, MethodName
from stickslip.engines.base import Task
from stickslip.engines.work import LOOK_AT_SCENE, Interrupted, SolverFailure
from stickslip.equations.forest import Forest
from stickslip.equations.loads.loads import Loads, Span
from stickslip.equations.one_thread import one_thread
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.events.impact import Jammed
from stickslip.events.situation import Inconsistent
from stickslip.model.checks import flag
from stickslip.model.laws.dry_friction import CurveError
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.model.when import When
from stickslip.simulation import arguments
from stickslip.simulation.arguments import Formulation, Times
from stickslip.simulation.choice import choose, why_stiff
from stickslip.simulation.recorder import Recorder
from stickslip.simulation.result import Result, SimulationError, SimulationInterrupted
from stickslip.simulation.run import Run
from stickslip.simulation.tolerances import ReachedSizes, tolerances
from stickslip.simulation.watching import Watch

_METHODS = ("auto", *(name for name, known in METHODS.items() if "contact-force" in known.formulations))
_FORMULATIONS = get_args(Formulation)


def simulate(  # noqa: PLR0913  (what a user types: options by keyword)
    scene: Scene,
    t_span: Times,
    *,
    formulation: Formulation = "contact-force",
    method: MethodName = "auto",
    step: float | None = None,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    t_eval: Iterable[float] | None = None,
    velocity_margin: float | None = None,
    events: Iterable[When] = (),
    max_step: float = math.inf,
    dense_output: bool = True,
    progress: bool = False,
) -> Result:
    """Simulate a scene with exact sticking and exact events.

    Between events the motion follows ``M v' = F - G^T r`` with the contact forces r of Breedveld (2000), eqs. (1)
    and (5)-(9), up to the first root of ``w`` of a slipping or ``B -+ lambda`` of a stuck contact.

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
        "auto": Taylor series where loads and laws are linear between events, else CVODE's BDF; `explain` says which
        and why. "series": exact to roundoff, whatever the tolerances. "BDF" or "Adams": CVODE. "RK4" or "Euler":
        fixed steps, with changes of mode at their ends.
    step : float, optional
        Step in s of the fixed-step methods. One too long for the fastest decay in the scene ends in an error that
        names the longest; with Euler's method oscillations grow by ``exp(step omega^2 t / 2)``.
    rtol, atol : float
        Relative tolerance, between 1e-14 and 0.1, and absolute tolerance of the states; the series needs none. An
        absolute tolerance that would hide how bodies move is tightened to ``rtol`` times the scene's velocities. If
        these follow from forces only, and all bodies turn out slower than ``1e5 atol``, or errors may add up to a tenth
        of a velocity, the run is made a second time; also if a state of a block stays below ``1e6 atol``. With sampled
        blocks there is no second run.
    t_eval : sequence of float, optional
        Times in s of the outputs; without it they are fit for a plot, every event twice.
    velocity_margin : float, optional
        Relative velocity in m/s or rad/s below which a contact counts as stuck once its velocities are constant; 0
        switches the check off. By default a hundred times what the tolerances leave uncertain, at
        most 1e-3 of the scene's velocities.
    events : sequence of When, optional
        Quantities whose crossings of 0 are noted among the events, or stop the simulation.
    max_step : float
        Longest step in s; a fixed `step` may not be longer.
    dense_output : bool
        Keep the motion between the outputs; False keeps only the outputs at `t_eval`.
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
    max_step = arguments.checked_max_step(max_step, stop - start)
    margin = arguments.margin(velocity_margin)
    outputs = arguments.outputs(t_eval, start, stop, dense_output)
    step = arguments.step_length(method, step, max_step, stop - start)
    arguments.check_laws(scene, start, stop)
    user_events, progress = arguments.user_events(scene, events), flag(progress, "simulate: progress")
    watched = [(f"event {one.name!r}", one.quantity) for one in user_events]
    system = System(scene, watched) if watched else compiled(scene)
    span = Span(start, stop, is_stepped=step is not None)
    loads = system.loads(*span)
    arguments.check_dwells(system, start, stop)
    arguments.check_ties(system, loads, start, stop)
    arguments.check_stops(system, loads, start, step)
    name, _ = choose(system, loads, formulation, method, stop - start)
    chosen, merged = METHODS[name], formulation == "merged"
    by_default = (method, name) == ("auto", "BDF") and not merged
    exact_at_rest = by_default and not why_stiff(system, stop - start)

    def run(loads: Loads, reached: ReachedSizes | None) -> tuple[Result, ReachedSizes | None]:
        """Return a run with tolerances fit for the sizes that an earlier run reached.

        With it the sizes that it has reached itself, None unless its tolerances hide its motion.
        """
        wanted = tolerances(system, start, stop, rtol, atol, margin, chosen, is_exact=name == "series", reached=reached)
        if system.dependence is not None:
            system.dependence.forget()
        task = Task(
            system,
            loads,
            wanted.rtol,
            wanted.atol,
            wanted.speeds,
            max_step=max_step,
            step=math.nan if step is None else step,
            merged=merged,
            exact_at_rest=exact_at_rest,
        )
        watch = Watch(system, user_events, loads, span.is_stepped) if user_events else None
        in_parts = name == "series" and max_step == math.inf and (watch is None or watch.reads_series)
        one = Run(
            task,
            chosen.make(task),
            Recorder(system, span, outputs, dense_output),
            span,
            wanted,
            watch,
            _forest(system, loads) if in_parts else None,
        )
        with one_thread(system, always=name != "series"):
            result = _Simulation(one, task, chosen.title).to_end(progress)
        # the functions of sampled blocks are called only once for each sample
        once_only = chosen.takes_steps or not wanted.has_errors or system.sampled
        return result, one.reached if not once_only and wanted.hide(one.reached) else None

    result, reached = run(loads, None)
    if reached is not None:
        # where the second run needs more than double precision, the first one is kept
        with contextlib.suppress(SimulationError, ValueError):
            result, _ = run(system.loads(*span), reached)
    return result


_MANY = 16  # number of bodies from which on scenes are followed part by part


def compiled(scene: Scene) -> System:
    """Return the scene as constant matrices, built once for each scene object."""
    if "system" not in scene.derived:
        scene.derived["system"] = System(scene)
    system: System = scene.derived["system"]
    return system


def _forest(system: System, loads: Loads) -> Forest | None:
    """Return the forest of a scene that can be followed part by part, built once for each scene and period."""
    if system.n < _MANY or Forest.why_not(system, loads) is not None:
        return None
    known = system.scene.derived
    forest: Forest | None = known.get("forest")
    # sines may lie outside of one time span, and within another
    if forest is None or forest.period != loads.period:
        forest = known["forest"] = Forest(system, loads.period)
    return forest


class _Simulation:
    """A run with its progress bar, its way out when something fails, and its counts."""

    def __init__(self, run: Run, task: Task, title: str) -> None:
        self._run, self._recorder, self._task, self._title = run, run.recorder, task, title

    def to_end(self, progress: bool) -> Result:
        """Advance to the end of the time span; an error or Ctrl-C carries what was computed."""
        run, timeline, interruption = self._run, self._run.timeline, self._task.interruption
        bar = _bar(timeline.duration) if progress else None
        if bar is not None:
            interruption.show = lambda tau: bar.update(max(timeline.gone + tau - bar.n, 0.0))
        try:
            with interruption:
                run.to_end()
        except SolverFailure as failure:
            cause = failure.__cause__ or failure
            sentence = self._whose(cause) + failure.sentence
            raise self._error(sentence, failure.remedy + self._where_functions_jump, failure.path) from cause
        except Inconsistent as conflict:
            names = self._names(conflict.rows.tolist())
            message = f"no consistent modes for the contacts {names}" if names else "no consistent modes"
            remedy = "their laws contradict each other: look at their coefficients"
            if math.isfinite(self._task.step):
                remedy = "shorten the step, or use BDF: a step may have leapt over a pre-slip velocity"
            raise self._error(message, remedy) from conflict
        except Jammed as conflict:
            names = self._names(conflict.rows.tolist())
            message = f"no motion is possible: {names} are pressed together by drives or ties"
            raise self._error(message, "use a Gap there, or let the drives leave room") from conflict
        except (ArithmeticError, ValueError) as fault:
            raise self._error(self._whose(fault) + str(fault), LOOK_AT_SCENE) from fault
        except KeyboardInterrupt as interrupted:
            t = self._keep(interrupted.path if isinstance(interrupted, Interrupted) else self._just_begun)
            message = f"interrupted at t = {t:.9g} s"
            raise SimulationInterrupted(message, self._result(message, -1)) from None
        finally:
            if bar is not None:
                bar.close()
        if run.stopped is not None:
            return self._result(f"event {run.stopped!r} stopped the simulation at t = {timeline.t:.9g} s", 1)
        return self._result("the end of the time span was reached", 0)

    def _whose(self, fault: BaseException) -> str:
        """Return the contacts whose law has failed, as a message begins with them."""
        if not isinstance(fault, CurveError):
            return ""
        rows = [j for j, law in enumerate(self._run.system.laws.laws) if law.core is fault.law]
        return f"contact {self._names(rows)}: " if rows else ""

    def _names(self, rows: list[int]) -> str:
        return ", ".join(repr(self._run.system.rows[j].name) for j in rows[:10])

    @property
    def _where_functions_jump(self) -> str:
        dependence = self._run.system.dependence
        if dependence is None or dependence.is_linear:
            return ""
        return "; feedback functions must be smooth: write corners with saturate or table, friction as a Contact"

    @property
    def _just_begun(self) -> Path | None:
        """The path of a motion that has been settled but not followed yet: the state at its start only."""
        now = self._run.now
        return None if now is None or now.motion.t != self._run.timeline.t else Path.of_start(now.motion.y)

    def _keep(self, path: Path | None) -> float:
        """Keep the path of a motion that was broken off; return the time of its last point."""
        run = self._run
        if run.now is None or path is None:
            return run.timeline.t
        t = run.now.motion.t + float(path.taus[-1])
        self._recorder.keep(run.now, path, t)
        return t

    def _error(self, message: str, remedy: str, path: Path | None = None) -> SimulationError:
        run = self._run
        t = self._keep(path)
        modes = {}
        if run.now is not None:
            labels = run.now.labels.tolist()
            modes = {row.name: Mode(k) for row, k in zip(run.system.rows, labels, strict=True)}
        listed = ", ".join(f"{name} {mode.name}" for name, mode in list(modes.items())[:10])
        shown = f"; modes: {listed or 'not settled yet'}" if run.system.rows else ""
        text = f"at t = {t:.9g} s: {message}{shown}; {remedy}"
        return SimulationError(text, t, modes, self._result(text, -1))

    def _result(self, message: str, status: int) -> Result:
        work, size, dependence = self._run.engine.work, self._run.system.size, self._run.system.dependence
        stats: dict[str, Any] = {
            "states": size,
            "fewest_states": self._recorder.fewest_states if self._task.merged else size,
            "guards": int(self._run.most_guards),
            "restarts": self._run.timeline.restarts,
            "steps": work.steps,
            "rate_calls": work.rate_calls,
            "jacobian_calls": work.jacobian_calls,
            "guard_calls": work.guard_calls,
            "function_calls": 0 if dependence is None else dependence.calls,
            "samples": self._run.samples,
            "solvers": work.solvers,
            "guards_excluded": work.guards_excluded,
            "guards_isolated": work.guards_isolated,
            "engine": self._title,
        }
        return self._recorder.result(message, status, stats)


def _bar(span: float) -> Any:
    from tqdm import tqdm

    return tqdm(total=span, unit="s", desc="simulated", bar_format="{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}]")
