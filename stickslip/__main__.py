"""The command line: ``python -m stickslip`` runs the benchmark, ``... run FILE`` a scene file."""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import sys
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.benchmark import BENCHMARK_SPAN, EXACT_EVENTS, EXACT_FINAL_VELOCITY, flywheel_benchmark
from stickslip.model.scene import Scene
from stickslip.results.files import save, to_csv, to_json
from stickslip.simulation.result import Result, SimulationError, SimulationInterrupted
from stickslip.simulation.simulate import simulate

__all__ = ["main"]

_OK, _FAILED, _BAD_INPUT, _INTERRUPTED = 0, 1, 2, 130
_REPEATS = 10
_ENGINES: tuple[dict[str, Any], ...] = (
    {"method": "series"},
    {"method": "BDF"},
    {"method": "Adams"},
    {"formulation": "multiplier"},
)
_EVENTS_SHOWN = 40
_SIMULATION = (
    "span",
    "rtol",
    "atol",
    "method",
    "formulation",
    "step",
    "points",
    "velocity_margin",
    "max_step",
)


class _BadInput(Exception):
    """What was asked for cannot be done; the message says what to change."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 ok, 1 the simulation failed, 2 bad input.

    Parameters
    ----------
    arguments : sequence of str, optional
        By default those of the process.
    """
    try:
        chosen = _parser().parse_args(arguments)
        job: Callable[[argparse.Namespace], int] = chosen.job
        return job(chosen)
    except _BadInput as error:
        print(f"stickslip: {error}", file=sys.stderr)
        return _BAD_INPUT
    except SimulationError as error:
        print(f"stickslip: {error}", file=sys.stderr)
        return _FAILED
    except BrokenPipeError:
        # whoever read the output has seen enough; the files are written
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        return _OK
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else _BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m stickslip",
        description="Dry friction with exact sticking and exact events. Without a command, the benchmark "
        "of Breedveld (2000) is run and compared with its exact event times.",
    )
    parser.set_defaults(job=_benchmark)
    _tolerances(parser)
    where = parser.add_mutually_exclusive_group()
    figure = "stickslip-benchmark.png"
    where.add_argument(
        "--plot", metavar="FILE", default=figure, help=f"where the figure goes (default {figure})"
    )
    where.add_argument("--no-plot", action="store_true", help="draw nothing")

    commands = parser.add_subparsers(title="commands")
    run = commands.add_parser(
        "run", help="simulate a scene file", description="Simulate a TOML or JSON scene file."
    )
    run.set_defaults(job=_run)
    run.add_argument(
        "scene", help="scene file in the form of Scene.to_dict, with an optional table 'simulation'"
    )
    run.add_argument("--span", nargs=2, type=float, metavar=("T0", "T1"), help="start and end in s")
    run.add_argument("--points", type=int, metavar="N", help="output at N even times instead of every step")
    run.add_argument("--method", help="BDF or Adams; RK4 or Euler with --step")
    run.add_argument("--formulation", help="contact-force, merged or multiplier")
    run.add_argument("--step", type=float, help="step in s of RK4 and Euler")
    _tolerances(run)
    for kind, what in (
        ("plot", "a figure (png, svg, pdf)"),
        ("csv", "times, velocities, forces and modes"),
        ("json", "events, counts and the final state"),
        ("save", "everything without loss (npz)"),
    ):
        run.add_argument(f"--{kind}", metavar="FILE", help=f"write {what}")
    run.add_argument("--progress", action="store_true", help="progress bar even if stderr is not a terminal")
    return parser


def _tolerances(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rtol", type=float, help="relative tolerance of the states")
    parser.add_argument("--atol", type=float, help="absolute tolerance of the states")


# -- the benchmark ----------------------------------------------------------------------------------------


def _benchmark(chosen: argparse.Namespace) -> int:
    plot = None if chosen.no_plot else chosen.plot
    _check_folders({"plot": plot})
    options = {name: value for name in ("rtol", "atol") if (value := getattr(chosen, name)) is not None}
    timed = [_timed(options | engine) for engine in _ENGINES]
    result, durations = timed[0]
    print("Two flywheels and a brake (Breedveld 2000, table 1), against exact answers\n")
    _print_events(result)
    for name in ("wheel1", "wheel2"):
        final = float(result.velocity(name)[-1])
        error = final - EXACT_FINAL_VELOCITY
        print(f"{name + ' at the end [rad/s]':32}{final:>18.15f}{EXACT_FINAL_VELOCITY:>18.15f}{error:>10.1e}")
    print("\nwork: " + ", ".join(f"{name} {value}" for name, value in result.stats.items()))
    span, median = BENCHMARK_SPAN[1] - BENCHMARK_SPAN[0], statistics.median(durations[1:])
    print(
        f"time: {span:g} s simulated in {1e3 * median:.2f} ms, {span / median:,.0f} times faster than real time\n"
    )
    _print_engines(timed)
    if plot:
        # the last three seconds show two wheels that turn together
        _draw(result, plot, t_span=(0.0, 1.0))
        print(f"figure: {plot} (its first second; nothing changes after)")
    return _OK if all(_same_story(result) for result, _ in timed) else _FAILED


def _timed(options: Mapping[str, Any]) -> tuple[Result, list[float]]:
    """Return the benchmark's result, and how long in s each of several runs took."""
    durations = []
    for _ in range(1 + _REPEATS):
        started = time.perf_counter()
        result = _simulated(flywheel_benchmark(), BENCHMARK_SPAN, options)
        durations.append(time.perf_counter() - started)
    return result, durations


def _print_engines(timed: Sequence[tuple[Result, list[float]]]) -> None:
    """Print what each engine finds, its largest errors, and its times."""
    print("engine           events   error of a time   of a velocity      cold      warm")
    for result, durations in timed:
        found = zip(result.events, EXACT_EVENTS, strict=False)
        late = max((abs(event.t - exact.t) for event, exact in found), default=math.nan)
        finals = (float(result.velocity(body.name)[-1]) for body in result.scene.bodies)
        off = max(abs(v - EXACT_FINAL_VELOCITY) for v in finals)
        same = "the same" if _same_story(result) else "OTHERS"
        cold, warm = 1e3 * durations[0], 1e3 * statistics.median(durations[1:])
        print(
            f"{result.stats['engine']:14}{same:>9}{late:>16.1e} s{off:>10.1e} rad/s{cold:>7.1f} ms{warm:>7.2f} ms"
        )
    print(f"(cold: the first run, with what it has to import; warm: the median of {_REPEATS} more)\n")


def _print_events(result: Result) -> None:
    print(f"{'event [s]':32}{'simulated':>18}{'exact':>18}{'error':>10}")
    for i in range(max(len(result.events), len(EXACT_EVENTS))):
        found = result.events[i] if i < len(result.events) else None
        exact = EXACT_EVENTS[i] if i < len(EXACT_EVENTS) else None
        event = found or exact
        assert event is not None
        text = f"{event.contact} {event.before.name} -> {event.after.name}"
        cells = ["missing" if e is None else f"{e.t:.15f}" for e in (found, exact)]
        error = "" if found is None or exact is None else f"{found.t - exact.t:.1e}"
        print(f"{text:32}{cells[0]:>18}{cells[1]:>18}{error:>10}")


def _same_story(result: Result) -> bool:
    found = [(e.contact, e.before, e.after) for e in result.events]
    return found == [(e.contact, e.before, e.after) for e in EXACT_EVENTS]


# -- scene files ------------------------------------------------------------------------------------------


def _run(chosen: argparse.Namespace) -> int:
    outputs = {kind: getattr(chosen, kind) for kind in ("plot", "csv", "json", "save")}
    _check_folders(outputs)
    data = _read(Path(chosen.scene))
    given = data.pop("simulation", {})
    options = _options(chosen, given)
    try:
        scene = Scene.from_dict(data)
    except (ValueError, TypeError) as error:
        raise _BadInput(f"{chosen.scene}: {error}") from None
    span = options.pop("span")
    options["progress"] = chosen.progress or sys.stderr.isatty()
    code = _OK
    try:
        result = _simulated(scene, span, options)
    except SimulationError as error:
        print(f"stickslip: {error}", file=sys.stderr)
        result, code = error.result, _FAILED
    except SimulationInterrupted as stop:
        print(f"stickslip: {stop}; what was computed is kept", file=sys.stderr)
        result, code = stop.result, _INTERRUPTED
    _write(result, outputs)
    _print_run(result)
    return code


def _read(path: Path) -> dict[str, Any]:
    readers: dict[str, Callable[[str], Any]] = {".toml": tomllib.loads, ".json": json.loads}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise _BadInput(f"{path}: unknown kind of file {path.suffix!r}; give a .toml or .json scene file")
    try:
        data = reader(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _BadInput(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise _BadInput(f"{path}: not valid {path.suffix[1:].upper()}: {error}") from None
    if not isinstance(data, dict):
        raise _BadInput(f"{path}: expected a table with bodies, contacts, ...; got {type(data).__name__}")
    return data


def _options(chosen: argparse.Namespace, given: Any) -> dict[str, Any]:
    """Return the arguments of `simulate`: those of the command line before those of the file."""
    if not isinstance(given, Mapping):
        raise _BadInput(f"{chosen.scene}: simulation must be a table, got {given!r}")
    unknown = [name for name in given if name not in _SIMULATION]
    if unknown:
        known = ", ".join(_SIMULATION)
        raise _BadInput(f"{chosen.scene}: simulation: unknown entry {unknown[0]!r}; known are {known}")
    typed = {name: value for name in _SIMULATION if (value := getattr(chosen, name, None)) is not None}
    options = {**given, **typed}
    if "span" not in options:
        raise _BadInput(
            f"{chosen.scene}: no time span; give --span T0 T1, or span = [T0, T1] in table simulation"
        )
    points = options.pop("points", None)
    if points is not None:
        options["t_eval"] = _even_times(options["span"], points)
    return options


def _even_times(span: Any, points: Any) -> Any:
    if not isinstance(points, int) or isinstance(points, bool) or points < 2:
        raise _BadInput(f"points must be a whole number from 2 on, got {points!r}")
    try:
        start, stop = map(float, span)
        return np.linspace(start, stop, points)
    except (TypeError, ValueError):
        raise _BadInput(f"span must be two times [T0, T1], got {span!r}") from None


def _simulated(scene: Scene, span: Any, options: Mapping[str, Any]) -> Result:
    try:
        return simulate(scene, span, **options)
    except (ValueError, TypeError) as error:
        raise _BadInput(str(error)) from None


def _print_run(result: Result) -> None:
    print(result.message)
    for event in result.events[:_EVENTS_SHOWN]:
        print(f"  {event}")
    if len(result.events) > _EVENTS_SHOWN:
        print(f"  ... and {len(result.events) - _EVENTS_SHOWN} more events; --json FILE writes all")
    if result.t.size:
        print(f"velocities at {result.t[-1]:.12g} s [m/s | rad/s]")
        for body in result.scene.bodies[:_EVENTS_SHOWN]:
            print(f"  {body.name}: {result.velocity(body.name)[-1]:.12g}")
    print("work: " + ", ".join(f"{name} {value}" for name, value in result.stats.items()))


# -- files ------------------------------------------------------------------------------------------------


def _check_folders(outputs: Mapping[str, str | None]) -> None:
    for kind, path in outputs.items():
        if path and not Path(path).resolve().parent.is_dir():
            raise _BadInput(f"--{kind} {path}: there is no folder {Path(path).parent}; make it first")


def _write(result: Result, outputs: Mapping[str, str | None]) -> None:
    writers: dict[str, Callable[[Result, str], None]] = {
        "csv": to_csv,
        "json": to_json,
        "save": save,
        "plot": _draw,
    }
    for kind, writer in writers.items():
        path = outputs[kind]
        if path is None:
            continue
        if kind == "plot" and not result.t.size:
            print("stickslip: nothing was computed that could be drawn", file=sys.stderr)
            continue
        try:
            writer(result, path)
        except OSError as error:
            raise _BadInput(f"--{kind} {path}: cannot be written: {error.strerror}") from None


def _draw(result: Result, path: str, **options: Any) -> None:
    from stickslip import plots

    try:
        plots.overview(result, **options).savefig(path, dpi=150)
    except ValueError as error:  # a format that matplotlib does not know
        raise _BadInput(f"--plot {path}: {error}") from None


if __name__ == "__main__":
    sys.exit(main())
