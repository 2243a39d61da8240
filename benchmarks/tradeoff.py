"""Error against time for every way of simulating a scene that `stickslip` offers, on five scenes.

    python -m benchmarks.tradeoff [--quick] [--figures DIR]

The flywheel benchmark and four viscous flywheels are judged by exact answers, Leine's belt, a chain of 50
blocks on a belt, and a servo that hunts by converged event-exact runs. For each method: the time to velocity errors
from 1e-1 to 1e-9, how many of the events it finds, and how fast contacts creep that stick. Then the comparison of
Breedveld (2000, section 8) at fixed steps: the contact-force model against the pre-slip model. The tables are Markdown;
the last one, of all scenes, is the README's.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.scaling import blocks
from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Karnopp,
    LuGre,
    Result,
    Scene,
    Spring,
    StateSpace,
    output,
    position,
    simulate,
    velocity,
)
from stickslip.engines import MethodName
from stickslip.plots.style import COLOURS
from stickslip.studies.tradeoff import Tradeoff, tradeoff
from stickslip.studies.tradeoff_setups import calls
from stickslip.studies.work_precision import Setup, WorkPrecision, WorkRow, work_precision
from validation.exact import Story, reference, two_flywheels

LEVELS = (1e-1, 1e-2, 1e-3, 1e-6, 1e-9)
FLOOR = 1e-14  # errors below are drawn there
NEAR = 1e-2  # an event counts as found within this part of the span; beside an event nobody asks for creep

# Families that share a line in the table of all scenes.
NAMES = {
    "Taylor series, the default": ("contact-force, series",),
    "CVODE BDF": ("contact-force, BDF", "merged, BDF"),
    "CVODE Adams": ("contact-force, Adams", "merged, Adams"),
    "IDA, multipliers": ("multiplier, BDF",),
    "RK4, exact laws": ("contact-force, RK4",),
    "Euler, exact laws": ("contact-force, Euler",),
    "LuGre, BDF": ("LuGre, BDF",),
    "Karnopp, RK4": ("Karnopp, RK4",),
    **{
        f"pre-slip {shape}, {title}": tuple(f"pre-slip {shape}, {method}" for method in methods)
        for shape in ("linear", "tanh", "arctan")
        for title, methods in {"stiff solver": ("BDF",), "fixed steps": ("RK4", "Euler")}.items()
    },
}

# Dead bands and bristle velocities, as parts of the velocity scale, of the laws that `tradeoff` does not try.
BANDS = (1e-1, 1e-2, 1e-3, 1e-4)

# Numbers of steps of the comparison at fixed steps; fewer make the pre-slip model unstable.
STEPS = {"contact force": (1000, 3000, 10_000, 30_000, 100_000), "pre-slip": (30_000, 100_000, 300_000)}
FIXED: tuple[MethodName, ...] = ("RK4", "Euler")
PRE_SLIP = 1e-3  # pre-slip velocity in rad/s of the comparison at fixed steps: the paper's, table 1


@dataclass(frozen=True)
class Case:
    """A scene to study; `story` has its exact answer where there is one, `weight` multiplies its budget.

    `level` is a breakaway force in N or N m, and `speed` a velocity in m/s or rad/s, of which the bristles are made.
    """

    key: str
    title: str
    scene: Scene
    span: tuple[float, float]
    story: Story | None = None
    weight: float = 1.0
    level: float = 1.0
    speed: float = 1.0


def leines_belt() -> Scene:
    """Return the block on a belt of Leine et al. (1998), whose friction falls with speed."""
    law = DryFriction(1.0, 1.0, kinetic=lambda v: 1.0 / (1.0 + 3.0 * abs(v)))
    return Scene(
        Drive("belt", velocity=0.2),
        Body("block", inertia=1.0, velocity=0.0),
        Contact("friction", "block", "belt", law, normal=1.0),
        Spring("block", GROUND, stiffness=1.0),
    )


def hunting_servo() -> Scene:
    """Return the PID controller with stiction of Armstrong and Amin (1996), which hunts for ever."""
    return Scene(
        Body("servo", inertia=1.0, position=0.2),
        Contact("friction", "servo", GROUND, DryFriction(1.5, 1.0), normal=1.0),
        StateSpace("integral", 0.0, 1.0, 1.0, inputs=[position("servo")]),
        Force("servo", -6.0 * velocity("servo") - 3.0 * position("servo") - 4.0 * output("integral")),
    )


def cases() -> list[Case]:
    """Return the scenes."""
    benchmark, viscous = two_flywheels(), reference("flywheels-4-viscous")
    return [
        Case("benchmark", "flywheel benchmark", benchmark.scene, (0.0, benchmark.stop), benchmark, level=20.0),
        Case("viscous", "four viscous flywheels", viscous.scene, (0.0, viscous.stop), viscous, level=12.0),
        Case("leine", "Leine's belt", leines_belt(), (0.0, 40.0)),
        Case("blocks", "50 blocks on a belt", blocks(50), (0.0, 5.0), weight=3.0, level=1.75),
        Case("hunting", "a servo that hunts", hunting_servo(), (0.0, 60.0), level=1.5, speed=0.1),
    ]


def exact_error(story: Story) -> Callable[[Result], float]:
    """Return the largest deviation from an exact answer as an error function."""
    names = [body.name for body in story.scene.bodies]
    rows = [names.index(name) for name in story.bodies]

    def error(result: Result) -> float:
        return float(np.abs(result(story.t)[rows].T - story.velocities).max())

    return error


def study(case: Case, budget: float) -> Tradeoff:
    """Measure every way to simulate a scene."""
    if case.story is None:
        return tradeoff(case.scene, case.span, budget=budget)
    error = exact_error(case.story)
    return tradeoff(case.scene, case.span, error=lambda result, _: error(result), budget=budget)


# -- the paper's comparison -------------------------------------------------------------------------------


def fixed_steps(quick: bool) -> WorkPrecision:
    """Measure the benchmark at fixed steps, with and without a pre-slip velocity."""
    story = two_flywheels()
    span = (0.0, story.stop)
    scenes = {"contact force": story.scene, "pre-slip": story.scene.regularized(PRE_SLIP)}
    setups = []
    for model, scene in scenes.items():
        for method, count in product(FIXED, STEPS[model][: -1 if quick else None]):
            step, family = span[1] / count, f"{model}, {method}"

            def run(scene: Scene = scene, method: MethodName = method, step: float = step) -> Result:
                return simulate(scene, span, method=method, step=step)

            setups.append(Setup(f"{family}, step {step:.2g} s", run, family=family))
    measured = exact_error(story)

    def error(result: Result) -> float:
        with np.errstate(all="ignore"):
            return measured(result)

    return work_precision(setups, error=error, repeats=1 if quick else 3, warmup=0, error_label="error / (rad/s)")


def advantage(work: WorkPrecision) -> list[str]:
    """Say how much faster the contact-force model reaches the accuracy of the pre-slip model."""
    lines = []
    for method in ("RK4", "Euler"):
        usable = [row for row in work.rows if row.failure is None and row.error < 10 * PRE_SLIP]
        smooth = [row for row in usable if row.family == f"pre-slip, {method}"]
        hard = [row for row in usable if row.family == f"contact force, {method}"]
        if not smooth:
            lines.append(f"{method}: no step of those tried gives the pre-slip model its accuracy")
            continue
        theirs = min(smooth, key=lambda row: row.median)
        ours = [row for row in hard if row.error <= theirs.error]
        if not ours:
            best = min((row.error for row in hard), default=math.inf)
            lines.append(f"{method}: pre-slip reaches {theirs.error:.1e}, the contact force {best:.1e} at these steps")
            continue
        fastest = min(ours, key=lambda row: row.median)
        ratio = theirs.median / fastest.median
        lines.append(
            f"{method}: {fastest.name} is {ratio:.1f} times faster than {theirs.name} "
            f"(errors {fastest.error:.1e} and {theirs.error:.1e}; the paper says about ten times)"
        )
    return lines


# -- tables -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Line:
    """One family on one scene: its rows, the events found of all, and the creep in m/s or rad/s of what sticks.

    Without rows it was left out, for its quickest call took longer than its share of the time. The creep is not a
    number where no call succeeds.
    """

    family: str
    rows: tuple[WorkRow, ...]
    found: int
    events: int
    creep: float


def time_for(rows: Sequence[WorkRow], error: float) -> str:
    """Return the shortest time in ms within an error; or, in brackets, the smallest error reached."""
    valid = [row for row in rows if row.failure is None]
    times = [row.median for row in valid if row.error <= error]
    if times:
        return f"{1e3 * min(times):.3g}"
    if valid:
        return f"({min(row.error for row in valid):.0e})"
    return "fails" if rows else "too slow"


def told(creep: float) -> str:
    """Return a creep as text; what is below roundoff of the velocities is none."""
    if math.isnan(creep):
        return "-"
    return "0" if creep < 1e-12 else f"{creep:.0e}"


def changes(result: Result) -> list[tuple[float, str, bool]]:
    """Return time, contact, and whether it sticks from then on, of all events at which contacts stick or let go."""
    return [(e.t, e.contact, e.after == 0) for e in result.events if (e.before == 0) != (e.after == 0)]


class Judge:
    """Compares runs of a scene with an exact answer, or with a tight run."""

    def __init__(self, case: Case) -> None:
        exact = simulate(case.scene, case.span, rtol=1e-11, atol=1e-13)
        times, self._contacts = np.linspace(*case.span, 1001), case.scene.contacts
        self._near = NEAR * (case.span[1] - case.span[0])
        self.changes = changes(exact)
        self._sample = exact.sample(times)
        count = len(case.scene.bodies)
        velocities = exact(times)[:count]

        def error(result: Result) -> float:
            return float(np.abs(result(times)[:count] - velocities).max())

        self.error: Callable[[Result], float] = exact_error(case.story) if case.story else error

    def found(self, result: Result) -> int:
        """Return how many of the changes a run has, too; each counts once."""
        left, count = changes(result), 0
        for t, contact, sticks in self.changes:
            near = [c for c in left if c[1:] == (contact, sticks) and abs(c[0] - t) <= self._near]
            if near:
                left.remove(min(near, key=lambda c: abs(c[0] - t)))
                count += 1
        return count

    def creep(self, result: Result) -> float:
        """Return the largest relative velocity in m/s or rad/s while a contact sticks in the exact run."""
        t, largest = self._sample.t, 0.0
        values = result.sample(t)
        for contact in self._contacts:
            times = np.array([time for time, name, _ in self.changes if name == contact.name])
            apart = np.abs(t[:, None] - times).min(axis=1, initial=math.inf) > self._near
            stuck = apart & (self._sample.mode(contact.name) == 0)
            if stuck.any():
                largest = max(largest, float(np.abs(values.relative_velocity(contact.name)[stuck]).max()))
        return largest


def lines_of(case: Case, judge: Judge, work: WorkPrecision, runs: dict[str, Callable[[], Result]]) -> list[Line]:
    """Return a line for each family; events and creep are those of its quickest run within the second level."""
    lines = []
    grouped: dict[str, list[WorkRow]] = {call.family: [] for call in calls(case.scene, case.span, 1.0)}
    for row in work.rows:
        grouped.setdefault(row.family or row.name, []).append(row)
    for family, rows in grouped.items():
        valid = [row for row in rows if row.failure is None]
        found, creep = 0, math.nan
        if valid:
            good = [row for row in valid if row.error <= LEVELS[1]]
            chosen = min(good, key=lambda row: row.median) if good else min(valid, key=lambda row: row.error)
            if chosen.call is None:
                result = runs[chosen.name]()
            else:
                result = eval(chosen.call, {"simulate": simulate, "scene": case.scene})
            found, creep = judge.found(result), judge.creep(result)
        lines.append(Line(family, tuple(rows), found, len(judge.changes), creep))
    return lines


def table(lines: Sequence[Line]) -> str:
    """Return the times at some errors, one line per family, as Markdown.

    In brackets stands the smallest error of a family where it reaches no smaller one.
    """
    heads = ["method", *(f"ms to {level:.0e}" for level in LEVELS), "events", "creep"]
    text = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for line in lines:
        found = "-" if math.isnan(line.creep) else f"{line.found} of {line.events}"
        cells = [line.family, *(time_for(line.rows, level) for level in LEVELS), found, told(line.creep)]
        text.append("| " + " | ".join(cells) + " |")
    return "\n".join(text)


def overview(lines: dict[str, list[Line]]) -> str:
    """Return one table of all scenes: the times in ms to errors of 1e-2 and 1e-6, and the worst of events and creep."""
    heads = ["method", *lines, "events found", "creep"]
    text = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for title, families in NAMES.items():
        shown = [[line for line in of_scene if line.family in families] for of_scene in lines.values()]
        cells = []
        for chosen in shown:
            rows = [row for line in chosen for row in line.rows]
            times = " / ".join(time_for(rows, level) for level in (1e-2, 1e-6))
            cells.append((times if rows else "too slow") if chosen else "does not apply")
        valid = [line for chosen in shown for line in chosen if not math.isnan(line.creep)]
        part = min((line.found / max(line.events, 1) for line in valid), default=math.nan)
        creep = max((line.creep for line in valid), default=math.nan)
        text.append("| " + " | ".join([title, *cells, f"{part:.0%}" if valid else "-", told(creep)]) + " |")
    return "\n".join(text)


def failures(rows: Sequence[WorkRow]) -> list[str]:
    """Say why families of which no call succeeds do not."""
    reasons: dict[str, str] = {}
    for row in rows:
        family = row.family or row.name
        reasons[family] = "" if row.failure is None else reasons.get(family, row.failure)
    return [f"{family} fails: {reason}" for family, reason in reasons.items() if reason]


def other_laws(
    case: Case, found: Tradeoff, error: Callable[[Result], float]
) -> tuple[WorkPrecision, dict[str, Callable[[], Result]]]:
    """Measure LuGre's bristles, and Karnopp's dead band where contacts allow it; return the runs by name, too."""
    setups = []
    for part in BANDS:
        velocity = part * case.speed
        stiffness = case.level / (velocity * 0.01)
        bristles = case.scene.with_laws(lambda law, s=stiffness: LuGre(law.core, s, damping=s**0.5))  # type: ignore[misc]
        runs = [("LuGre, BDF", bristles, {"method": "BDF", "rtol": 1e-3 * part, "atol": 1e-5 * part})]
        with suppress(ValueError):
            banded = case.scene.with_laws(lambda law, v=velocity: Karnopp(law.core, v))  # type: ignore[misc]
            for count in (300, 3000, 30_000):
                step = (case.span[1] - case.span[0]) / count
                runs.append(("Karnopp, RK4", banded, {"method": "RK4", "step": step}))
        for family, scene, options in runs:

            def run(scene: Scene = scene, options: dict[str, Any] = options) -> Result:
                return simulate(scene, case.span, **options)

            setups.append(Setup(f"{family}, {velocity:.3g}, {options}", run, family=family))
    measured = work_precision(setups, error=error, repeats=1, warmup=0, error_label=found.work.error_label)
    return measured, {setup.name: setup.run for setup in setups}


def panels(lines: dict[str, list[Line]], limits: dict[str, float], file: Path) -> None:
    """Draw one small panel per scene: error against time; exact methods stand at the floor."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    figure = Figure(figsize=(11.0, 7.4), layout="constrained")
    axes = figure.subplots(2, 3, sharey=True).ravel()
    handles: dict[str, Any] = {}
    for ax, (title, of_scene) in zip(axes, lines.items(), strict=False):
        for number, (name, members) in enumerate(NAMES.items()):
            rows = tuple(row for line in of_scene if line.family in members for row in line.rows)
            front = WorkPrecision(rows).pareto()
            if not front:
                continue
            handles[name] = ax.loglog(
                [1e3 * row.median for row in front],
                [min(max(row.error, FLOOR), 3.0) for row in front],
                linestyle=["-", "--", ":"][number % 3],
                marker="os^vDPX"[number % 7],
                markersize=4.0,
                linewidth=1.0,
                color=COLOURS[number % len(COLOURS)],
            )[0]
        ax.axhspan(FLOOR / 3, max(limits[title], FLOOR), color="0.9", zorder=0)
        ax.set(title=title, xlabel="time [ms]", ylim=(FLOOR / 3, 4.0))
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(True, linewidth=0.3)
    for ax in axes[::3]:
        ax.set_ylabel("largest velocity error\n[m/s or rad/s]")
    for ax in axes[len(lines) :]:
        ax.axis("off")
    known = [name for name in NAMES if name in handles]
    axes[-1].legend([handles[name] for name in known], known, loc="center", fontsize="small", frameon=False)
    figure.savefig(file, dpi=150)


def save(draw: Callable[[], object], folder: Path, name: str, title: str) -> None:
    """Draw and save a figure."""
    axes = draw()
    axes.set(title=title, ylabel="largest velocity error / (m/s or rad/s)")  # type: ignore[attr-defined]
    figure = axes.figure  # type: ignore[attr-defined]
    figure.set_size_inches(10, 5.5)
    figure.savefig(folder / f"{name}.png", dpi=120)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, draw."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--quick", action="store_true", help="about three minutes in all")
    parser.add_argument("--figures", type=Path, metavar="DIR", help="where to save the figures")
    options = parser.parse_args(arguments)
    if options.figures:
        import matplotlib

        matplotlib.use("Agg")
        options.figures.mkdir(parents=True, exist_ok=True)
    lines: dict[str, list[Line]] = {}
    limits: dict[str, float] = {}
    for case in cases():
        try:
            found = study(case, case.weight * (20.0 if options.quick else 60.0))
        except ValueError as too_slow:
            print(f"\n## {case.title}\n\n{too_slow}")
            continue
        judge = Judge(case)
        others, runs = other_laws(case, found, judge.error)
        both = WorkPrecision((*found.work.rows, *others.rows))
        lines[case.title], limits[case.title] = lines_of(case, judge, both, runs), found.limit
        reference = "exact answer" if case.story else f"reference converged to {found.limit:.1e}"
        print(f"\n## {case.title} ({reference})\n\n{table(lines[case.title])}\n")
        print("\n".join(failures(both.rows)))
        for line in str(found).splitlines():
            if line.startswith("left out"):
                print(line)
        for level in LEVELS:
            try:
                print(f"error <= {level:.0e}: {found.recommend(error=level)}")
            except ValueError as none:
                print(f"error <= {level:.0e}: {none}")
        sys.stdout.flush()
        if options.figures:
            save(found.plot, options.figures, f"tradeoff-{case.key}", case.title)
    work = fixed_steps(options.quick)
    print(f"\n## Fixed steps, flywheel benchmark\n\n{work}\n")
    print("\n".join(advantage(work)))
    if options.figures:
        save(work.plot, options.figures, "tradeoff-fixed-steps", "flywheel benchmark, fixed steps")
    print(f"\n## All scenes: ms to 1e-2 / 1e-6\n\n{overview(lines)}")
    if options.figures:
        panels(lines, limits, options.figures / "tradeoff.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
