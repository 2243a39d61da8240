"""The command line: ``python -m stickslip`` runs the benchmark, ``... run FILE`` a scene file."""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import os
import statistics
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from stickslip import __version__
from stickslip.benchmark import BENCHMARK_SPAN, EXACT_EVENTS, EXACT_FINAL_VELOCITY, flywheel_benchmark
from stickslip.model.checks import whole
from stickslip.model.scene import Scene
from stickslip.results.files import save
from stickslip.results.tables import to_csv, to_json
from stickslip.results.units import units
from stickslip.simulation.arguments import span as times
from stickslip.simulation.explain import explain
from stickslip.simulation.result import Result, SimulationError, SimulationInterrupted
from stickslip.simulation.simulate import simulate
from stickslip.studies.scene_sweep import SceneRuns, values_of
from stickslip.studies.sweep_data import SweepResult
from stickslip.studies.sweeps import SweepInterrupted, sweep
from stickslip.studies.tradeoff import tradeoff

_OK, _FAILED, _BAD_INPUT, _INTERRUPTED = 0, 1, 2, 130
_REPEATS = 10
_ENGINES: tuple[dict[str, Any], ...] = (
    {"method": "series"},
    {"method": "BDF"},
    {"method": "Adams"},
    {"formulation": "multiplier"},
)
_EVENTS_SHOWN = 40
_DPI = 300

Job = Callable[[argparse.Namespace], int]


class _BadInput(Exception):
    """The command cannot be carried out; the message says what to change."""


@contextmanager
def _refusals(what: str = "") -> Iterator[None]:
    """Turn errors of arguments and of files into bad input; `what` begins the message."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _BadInput(f"{what}cannot be written: {error.strerror}") from None
    except (ValueError, TypeError) as error:
        raise _BadInput(f"{what}{error}") from None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 ok, 1 the simulation failed, 2 bad input, 130 interrupted."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # names may have letters that a terminal or a file does not know
            stream.reconfigure(errors="backslashreplace")
    try:
        chosen = _parser().parse_args(arguments)
        job: Job = chosen.job
        return job(chosen)
    except _BadInput as error:
        print(f"stickslip: {error}", file=sys.stderr)
        return _BAD_INPUT
    except SimulationError as error:
        print(f"stickslip: {error}", file=sys.stderr)
        return _FAILED
    except KeyboardInterrupt:
        print("stickslip: interrupted", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:
        # whoever read the output has seen enough; the files are written
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
        return _OK
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else _BAD_INPUT


_EXIT_CODES = """exit codes:
  0    all went well
  1    a simulation failed (what was computed is written), or the benchmark's events are not the exact ones
  2    bad input; the message says what to change
  130  interrupted (run and sweep write what was computed)"""


_TOLERANCES = ("rtol", "atol")
_OF_SIMULATE = ("span", "method", "formulation", "step", "max_step", "velocity_margin", *_TOLERANCES)
_FLAGS: dict[str, dict[str, Any]] = {
    "span": {"nargs": 2, "type": float, "metavar": ("T0", "T1"), "help": "start and end in s"},
    "method": {
        "metavar": "ENGINE",
        "help": "auto (default), series, BDF or Adams; RK4 or Euler with --step",
    },
    "formulation": {"metavar": "KIND", "help": "contact-force (default), merged or multiplier"},
    "step": {"type": float, "metavar": "S", "help": "step in s of RK4 and Euler"},
    "max_step": {"type": float, "metavar": "S", "help": "longest step in s"},
    "velocity_margin": {
        "type": float,
        "metavar": "W",
        "help": "relative velocity below which contacts relax to rest",
    },
    "rtol": {"type": float, "help": "relative tolerance of the states"},
    "atol": {"type": float, "help": "absolute tolerance of the states"},
    "points": {"type": int, "metavar": "N", "help": "output at N even times instead of times fit for a plot"},
    "progress": {"action": "store_true", "help": "progress bar even if stderr is not a terminal"},
    "budget": {"type": float, "default": 60.0, "metavar": "S", "help": "wall time in s (default 60)"},
    "workers": {"type": int, "metavar": "N", "help": "processes (default one per core)"},
    "value": {"metavar": "NAME", "help": "what is drawn, such as 'stuck floor' (default events)"},
    "vary": {
        "action": "append",
        "required": True,
        "metavar": "FIELD=VALUES",
        "help": "NAME.FIELD, or TABLE[NUMBER].FIELD where elements have no name; VALUES as 1,2,5 or START:STOP:COUNT "
        "or START:STOP:COUNT:log",
    },
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m stickslip",
        description="Dry friction with exact sticking and exact events. Without a command, the benchmark "
        "of Breedveld (2000) is run and compared with its exact event times.",
        epilog=f"example: python -m stickslip run scene.toml --plot run.png\n\n{_EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(job=_benchmark)
    parser.add_argument("--version", action="version", version=f"stickslip {__version__}")
    _add(parser, _TOLERANCES)
    where = parser.add_mutually_exclusive_group()
    figure = "stickslip-benchmark.png"
    where.add_argument("--plot", metavar="FILE", default=figure, help=f"where the figure goes (default {figure})")
    where.add_argument("--no-plot", action="store_true", help="draw nothing")

    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    run = _command(commands, "run", _run, "simulate a scene file", "--plot run.png --csv run.csv")
    _add(
        run,
        (*_OF_SIMULATE, "points", "progress"),
        plot="write a figure (png, svg, pdf)",
        report="write a report of the run (html)",
        csv="write motion, forces, modes, powers and energies over time",
        json="write events, counts and the final state",
        save="write everything without loss (npz)",
    )
    what = "say what a scene is compiled to, and which engine takes it"
    _add(_command(commands, "explain", _explain, what, "--span 0 10"), ("span",))
    draw = _command(commands, "draw", _draw_scene, "draw a scene file as a schematic", "--plot scene.svg")
    _add(draw, plot="where the figure goes (png, svg, pdf; default SCENE.png)")
    what = "measure what accuracy costs for a scene"
    measured = _command(commands, "tradeoff", _tradeoff, what, "--error 1e-6 --plot tradeoff.png")
    _add(measured, ("span", "budget"), plot="write a figure of error against time")
    aim = measured.add_mutually_exclusive_group()
    aim.add_argument("--error", type=float, help="recommend the fastest call with at most this velocity error")
    aim.add_argument("--time", type=float, help="recommend the most accurate call within this wall time in s")
    what = "run a scene file over a grid of its numbers"
    vary = "--vary floor.normal=1,5,10 --vary springs[0].stiffness=1:100:9:log"
    _add(
        _command(commands, "sweep", _sweep, what, f"{vary} --plot map.png --value 'stuck floor'"),
        ("vary", *_OF_SIMULATE, "value", "workers"),
        csv="write a line for each point of the grid",
        save="keep finished points, and go on from them",
        plot="draw a map of --value over the two fields that vary",
    )
    return parser


def _command(commands: Any, name: str, job: Job, what: str, example: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=what,
        description=f"{what[0].upper()}{what[1:]}.",
        epilog=f"example: python -m stickslip {name} scene.toml {example}\n\n{_EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(job=job)
    parser.add_argument(
        "scene", help="TOML or JSON file in the form of Scene.to_dict, with an optional table 'simulation'"
    )
    return parser


def _add(parser: argparse.ArgumentParser, flags: Sequence[str] = (), **files: str) -> None:
    """Add flags, and for each of `files` a flag that names a file, with its help text."""
    for flag in flags:
        parser.add_argument(f"--{flag.replace('_', '-')}", **_FLAGS[flag])
    for flag, what in files.items():
        parser.add_argument(f"--{flag}", metavar="FILE", help=what)


# -- the benchmark ----------------------------------------------------------------------------------------


def _benchmark(chosen: argparse.Namespace) -> int:
    plot = None if chosen.no_plot else chosen.plot
    _check_files({"plot": plot})
    options = {name: value for name in ("rtol", "atol") if (value := getattr(chosen, name)) is not None}
    scene = Scene(*flywheel_benchmark().elements, motion="rotation")
    timed = [_timed(scene, options | engine) for engine in _ENGINES]
    result, durations = timed[0]
    print("Two flywheels and a brake (Breedveld 2000, table 1), against exact answers\n")
    _print_events(result)
    for name in ("wheel1", "wheel2"):
        final = float(result.velocity(name)[-1])
        error = final - EXACT_FINAL_VELOCITY
        print(f"{name + ' at the end [rad/s]':32}{final:>18.15f}{EXACT_FINAL_VELOCITY:>18.15f}{error:>10.1e}")
    print("\nwork: " + ", ".join(f"{name} {value}" for name, value in result.stats.items()))
    span, median = BENCHMARK_SPAN[1] - BENCHMARK_SPAN[0], statistics.median(durations[1:])
    print(f"time: {span:g} s simulated in {1e3 * median:.2f} ms, {span / median:,.0f} times faster than real time\n")
    _print_engines(timed)
    if plot:
        # the last three seconds show two wheels that turn together
        _draw(result, plot, t_span=(0.0, 1.0))
        print(f"figure: {plot} (its first second; nothing changes after)")
    return _OK if all(_same_story(result) for result, _ in timed) else _FAILED


def _timed(scene: Scene, options: Mapping[str, Any]) -> tuple[Result, list[float]]:
    """Return the benchmark's result, and the durations of several runs in s."""
    durations = []
    for _ in range(1 + _REPEATS):
        started = time.perf_counter()
        result = _simulated(scene, BENCHMARK_SPAN, options)
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
        print(f"{result.stats['engine']:14}{same:>9}{late:>16.1e} s{off:>10.1e} rad/s{cold:>7.1f} ms{warm:>7.2f} ms")
    print(f"(cold: the first run, with what it has to import; warm: the median of {_REPEATS} more)\n")


def _print_events(result: Result) -> None:
    print(f"{'event [s]':32}{'simulated':>18}{'exact':>18}{'error':>10}")
    for found, exact in zip_longest(result.events, EXACT_EVENTS):
        event = found or exact
        text = f"{event.contact} {event.before.name} -> {event.after.name}"
        cells = ["missing" if e is None else f"{e.t:.15f}" for e in (found, exact)]
        error = "" if found is None or exact is None else f"{found.t - exact.t:.1e}"
        print(f"{text:32}{cells[0]:>18}{cells[1]:>18}{error:>10}")


def _same_story(result: Result) -> bool:
    found = [(e.contact, e.before, e.after) for e in result.events]
    return found == [(e.contact, e.before, e.after) for e in EXACT_EVENTS]


# -- scene files ------------------------------------------------------------------------------------------


def _run(chosen: argparse.Namespace) -> int:
    outputs = {kind: getattr(chosen, kind) for kind in ("plot", "report", "csv", "json", "save")}
    _check_files(outputs)
    scene, given = _scene_file(chosen)
    options = _options(chosen, given)
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


def _draw_scene(chosen: argparse.Namespace) -> int:
    target = chosen.plot or str(Path(chosen.scene).with_suffix(".png").name)
    _check_files({"plot": target})
    scene, _ = _scene_file(chosen)
    _save_figure(scene.draw, target)
    print(f"figure: {target}")
    return _OK


def _explain(chosen: argparse.Namespace) -> int:
    scene, given = _scene_file(chosen)
    span = chosen.span or (given.get("span") if isinstance(given, Mapping) else None)
    with _refusals():
        print(explain(scene, span))
    return _OK


def _tradeoff(chosen: argparse.Namespace) -> int:
    _check_files({"plot": chosen.plot})
    scene, given = _scene_file(chosen)
    span = _options(chosen, given)["span"]
    for name in ("error", "time"):
        # refused before a minute of measurements
        if (value := getattr(chosen, name)) is not None and not 0 < value < math.inf:
            raise _BadInput(f"--{name} {value:g}: give a positive number")
    with _refusals():
        study = tradeoff(scene, span, budget=chosen.budget, progress=sys.stderr.isatty())
        print(study)
        if chosen.error is not None or chosen.time is not None:
            print(f"recommended: {study.recommend(error=chosen.error, time=chosen.time)}")
    if chosen.plot:
        _save_figure(lambda: study.plot().figure, chosen.plot)
    return _OK


def _sweep(chosen: argparse.Namespace) -> int:
    _check_files({kind: getattr(chosen, kind) for kind in ("csv", "save", "plot")})
    scene, given = _scene_file(chosen)
    options = _options(chosen, given)
    runs = SceneRuns(scene, options.pop("span"), options)
    grid = _grid(runs, chosen.vary)
    varied = [path for path, values in grid.items() if len(values) > 1]
    if chosen.plot and len(varied) != 2:
        raise _BadInput(f"--plot draws a map over two fields, but {len(varied)} vary; see --csv")
    if chosen.value and chosen.value not in runs.values:
        raise _BadInput(f"--value {chosen.value}: no value is called so; choose from {', '.join(runs.values)}")
    code = _OK
    # with a single worker the sweep runs in this process
    how: dict[str, Any] = {"executor": "serial"} if chosen.workers == 1 else {"workers": chosen.workers}
    try:
        with _refusals():
            found = sweep(runs, grid, **how, progress=sys.stderr.isatty(), save=chosen.save, version=runs.version)
    except SweepInterrupted as stop:
        print(f"stickslip: {stop}", file=sys.stderr)
        found, code = stop.result, _INTERRUPTED
    if chosen.csv:
        _write_points(runs, found, chosen.csv)
    print(found)
    if chosen.plot and code == _OK:
        _draw_map(runs, found, varied, chosen)
    return _FAILED if found.failures and code == _OK else code


def _grid(runs: SceneRuns, texts: Sequence[str]) -> dict[str, list[float]]:
    """Return the values of each field that `--vary` names."""
    grid: dict[str, list[float]] = {}
    for text in texts:
        path, equals, values = text.partition("=")
        if not equals:
            raise _BadInput(f"--vary {text}: write FIELD=VALUES, such as floor.normal=1,5,10")
        if path in grid:
            raise _BadInput(f"--vary {path} stands twice; list all its values at once")
        with _refusals(f"--vary {text}: "):
            grid[path] = values_of(values)
    with _refusals("--vary: "):
        # a field that does not exist is refused here, and not once for each point
        runs.check(grid)
    return grid


def _write_points(runs: SceneRuns, found: SweepResult, path: str) -> None:
    with _refusals(f"--csv {path}: "), Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_heads(runs, found).values())
        for point, values in found.points():
            writer.writerow([*point.values(), *(float(value) for value in values.values())])


def _heads(runs: SceneRuns, found: SweepResult) -> dict[str, str]:
    """Return the parameters and values of a sweep by name, with their units."""
    names = (*found.parameters, *found.values)
    return {name: f"{name} [{unit}]" if (unit := runs.unit(name)) else name for name in names}


def _draw_map(runs: SceneRuns, found: SweepResult, varied: list[str], chosen: argparse.Namespace) -> None:
    from stickslip import plots

    value = chosen.value or "events"
    heads = _heads(runs, found)
    _save_figure(lambda: plots.sweep_map(found, varied[0], varied[1], value, labels=heads).figure, chosen.plot)


def _scene_file(chosen: argparse.Namespace) -> tuple[Scene, Any]:
    """Return the scene of a file, and its table 'simulation'."""
    data = _read(Path(chosen.scene))
    given = data.pop("simulation", {})
    with _refusals(f"{chosen.scene}: "):
        return Scene.from_dict(data), given


def _read(path: Path) -> dict[str, Any]:
    readers: dict[str, Callable[[str], Any]] = {".toml": tomllib.loads, ".json": json.loads}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise _BadInput(f"{path}: unknown kind of file {path.suffix!r}; give a .toml or .json scene file")
    try:
        data = reader(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise _BadInput(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise _BadInput(f"{path}: not valid {path.suffix[1:].upper()}: {error}") from None
    if not isinstance(data, dict):
        raise _BadInput(f"{path}: expected a table with bodies, contacts, ...; got {type(data).__name__}")
    return data


def _options(chosen: argparse.Namespace, given: Any) -> dict[str, Any]:
    """Return the arguments of `simulate`: those of the command line replace those of the file."""
    if not isinstance(given, Mapping):
        raise _BadInput(f"{chosen.scene}: simulation must be a table, got {given!r}")
    known = (*_OF_SIMULATE, "points")
    unknown = [name for name in given if name not in known]
    if unknown:
        raise _BadInput(f"{chosen.scene}: simulation: unknown entry {unknown[0]!r}; known are {', '.join(known)}")
    typed = {name: value for name in known if (value := getattr(chosen, name, None)) is not None}
    options = {**given, **typed}
    if "span" not in options:
        raise _BadInput(f"{chosen.scene}: no time span; give --span T0 T1, or span = [T0, T1] in table simulation")
    points = options.pop("points", None)
    if points is not None:
        with _refusals():
            options["t_eval"] = np.linspace(*times(options["span"], "simulation"), whole(points, "points", 2))
    return options


def _simulated(scene: Scene, span: Any, options: Mapping[str, Any]) -> Result:
    with _refusals():
        return simulate(scene, span, **options)


def _print_run(result: Result) -> None:
    print(result.message)
    for event in result.events[:_EVENTS_SHOWN]:
        print(f"  {event}")
    if len(result.events) > _EVENTS_SHOWN:
        print(f"  ... and {len(result.events) - _EVENTS_SHOWN} more events; --json FILE writes all")
    if result.t.size:
        print(f"velocities at {result.t[-1]:.12g} s")
        for body in result.scene.bodies[:_EVENTS_SHOWN]:
            unit = units(result.scene, body).velocity
            print(f"  {body.name}: {result.velocity(body.name)[-1]:.12g} {unit}")
    print("work: " + ", ".join(f"{name} {value}" for name, value in result.stats.items()))


# -- files ------------------------------------------------------------------------------------------------


def _check_files(outputs: Mapping[str, str | None]) -> None:
    for kind, path in outputs.items():
        if not path:
            continue
        # a name may be too long to look for
        with _refusals(f"--{kind} {path}: "):
            has_folder, is_folder = Path(path).resolve().parent.is_dir(), Path(path).is_dir()
        if not has_folder:
            raise _BadInput(f"--{kind} {path}: there is no folder {Path(path).parent}; make it first")
        if is_folder:
            raise _BadInput(f"--{kind} {path}: this is a folder; name a file")
    figure = outputs.get("plot") or ""
    # the usual ones are known without loading matplotlib
    if (suffix := Path(figure).suffix[1:].lower()) not in ("", "png", "svg", "pdf"):
        from stickslip.plots.style import formats

        if suffix not in formats():
            raise _BadInput(
                f"--plot {figure}: no figure can be written as .{suffix}; choose from {', '.join(formats())}"
            )


def _write(result: Result, outputs: Mapping[str, str | None]) -> None:
    writers: dict[str, Callable[[Result, str], None]] = {
        "csv": to_csv,
        "json": to_json,
        "save": save,
        "plot": _draw,
        "report": lambda result, path: result.report(path, title=Path(path).stem),
    }
    for kind, writer in writers.items():
        path = outputs[kind]
        if path is not None and kind == "plot" and not result.t.size:
            print("stickslip: nothing was computed that could be drawn", file=sys.stderr)
        elif path is not None:
            with _refusals(f"--{kind} {path}: "):
                writer(result, path)


def _draw(result: Result, path: str, **options: Any) -> None:
    from stickslip import plots

    _save_figure(lambda: plots.overview(result, **options), path)


def _save_figure(draw: Callable[[], Any], path: str) -> None:
    from stickslip.plots.style import apart_from_pyplot

    # a format that matplotlib does not know is a ValueError
    with _refusals(f"--plot {path}: "), apart_from_pyplot():
        draw().savefig(path, dpi=_DPI)


if __name__ == "__main__":
    sys.exit(main())
