"""Error against time for every way of simulating a scene that `stickslip` offers, on four scenes.

    python -m benchmarks.tradeoff [--quick] [--figures DIR]

The flywheel benchmark and four viscous flywheels are judged by exact answers, Leine's belt and a chain of 50
blocks on a belt by converged event-exact runs. Then the comparison of Breedveld (2000, section 8) at fixed
steps: the contact-force model against the pre-slip model. Ends with the tables as Markdown.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.scaling import blocks
from stickslip import GROUND, Body, Contact, Drive, DryFriction, Result, Scene, Spring, simulate
from stickslip.studies.tradeoff import Tradeoff, tradeoff
from stickslip.studies.work_precision import Setup, WorkPrecision, WorkRow, work_precision
from validation.exact import Story, reference, two_flywheels

LEVELS = (1e-2, 1e-4, 1e-6, 1e-9)
README_LEVELS = (1e-3, 1e-6)
STEPS = {"contact force": (1000, 3000, 10_000, 30_000, 100_000), "pre-slip": (30_000, 100_000, 300_000)}
"""Numbers of steps of the comparison at fixed steps; fewer make the pre-slip model unstable."""
PRE_SLIP = 1e-3
"""Pre-slip velocity in rad/s of the comparison at fixed steps: the paper's, table 1."""


@dataclass(frozen=True)
class Case:
    """A scene to study; `story` has its exact answer where there is one, `weight` multiplies its budget."""

    key: str
    title: str
    scene: Scene
    span: tuple[float, float]
    story: Story | None = None
    weight: float = 1.0


def leines_belt() -> Scene:
    """Return the block on a belt of Leine et al. (1998), whose friction falls with speed."""
    law = DryFriction(1.0, 1.0, kinetic=lambda v: 1.0 / (1.0 + 3.0 * abs(v)))
    return Scene(
        Drive("belt", velocity=0.2),
        Body("block", inertia=1.0, velocity=0.0),
        Contact("friction", "block", "belt", law, normal=1.0),
        Spring("block", GROUND, stiffness=1.0),
    )


def cases() -> list[Case]:
    """Return the scenes."""
    benchmark, viscous = two_flywheels(), reference("flywheels-4-viscous")
    return [
        Case("benchmark", "flywheel benchmark", benchmark.scene, (0.0, benchmark.stop), benchmark),
        Case("viscous", "four viscous flywheels", viscous.scene, (0.0, viscous.stop), viscous),
        Case("leine", "Leine's belt", leines_belt(), (0.0, 40.0)),
        Case("blocks", "50 blocks on a belt", blocks(50), (0.0, 5.0), weight=5.0),
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
        for method, count in product(("RK4", "Euler"), STEPS[model][: -1 if quick else None]):
            step, family = span[1] / count, f"{model}, {method}"

            def run(scene: Scene = scene, method: str = method, step: float = step) -> Result:
                return simulate(scene, span, method=method, step=step)

            setups.append(Setup(f"{family}, step {step:.2g} s", run, family=family))
    measured = exact_error(story)

    def error(result: Result) -> float:
        with np.errstate(all="ignore"):
            return measured(result)

    return work_precision(
        setups, error=error, repeats=1 if quick else 3, warmup=0, error_label="error / (rad/s)"
    )


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
            lines.append(
                f"{method}: pre-slip reaches {theirs.error:.1e}, the contact force {best:.1e} at these steps"
            )
            continue
        fastest = min(ours, key=lambda row: row.median)
        ratio = theirs.median / fastest.median
        lines.append(
            f"{method}: {fastest.name} is {ratio:.1f} times faster than {theirs.name} "
            f"(errors {fastest.error:.1e} and {theirs.error:.1e}; the paper says about ten times)"
        )
    return lines


# -- tables -----------------------------------------------------------------------------------------------


def families(work: WorkPrecision) -> dict[str, list[WorkRow]]:
    """Return the rows that succeeded, by family."""
    found: dict[str, list[WorkRow]] = {}
    for row in work.rows:
        if row.failure is None:
            found.setdefault(row.family or row.name, []).append(row)
    return found


def time_for(rows: Sequence[WorkRow], error: float) -> str:
    """Return the shortest time in ms within an error, as a cell of a table."""
    times = [row.median for row in rows if row.error <= error]
    return f"{1e3 * min(times):.3g}" if times else "-"


def table(work: WorkPrecision) -> str:
    """Return the times at some errors, one line per family, as Markdown."""
    lines = ["| method | smallest error | " + " | ".join(f"ms to {level:.0e}" for level in LEVELS) + " |"]
    lines.append("|---" * (2 + len(LEVELS)) + "|")
    for family, rows in families(work).items():
        cells = [
            family,
            f"{min(row.error for row in rows):.1e}",
            *(time_for(rows, level) for level in LEVELS),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def readme_table(studies: dict[str, WorkPrecision]) -> str:
    """Return one table of all scenes: times to the errors of the README, as Markdown."""
    levels = " / ".join(f"{level:.0e}" for level in README_LEVELS)
    lines = [
        f"| ms to an error of {levels} | " + " | ".join(studies) + " |",
        "|---" * (1 + len(studies)) + "|",
    ]
    grouped = [families(work) for work in studies.values()]
    for family in dict.fromkeys(name for found in grouped for name in found):
        cells = [
            " / ".join(time_for(found.get(family, []), level) for level in README_LEVELS) for found in grouped
        ]
        lines.append("| " + " | ".join([family, *cells]) + " |")
    return "\n".join(lines)


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
    parser.add_argument("--quick", action="store_true", help="a few seconds per scene")
    parser.add_argument("--figures", type=Path, metavar="DIR", help="where to save the figures")
    options = parser.parse_args(arguments)
    if options.figures:
        import matplotlib

        matplotlib.use("Agg")
        options.figures.mkdir(parents=True, exist_ok=True)
    studies = {}
    for case in cases():
        try:
            found = study(case, case.weight * (20.0 if options.quick else 60.0))
        except ValueError as too_slow:
            print(f"\n## {case.title}\n\n{too_slow}")
            continue
        studies[case.title] = found.work
        judge = "exact answer" if case.story else f"reference converged to {found.limit:.1e}"
        print(f"\n## {case.title} ({judge})\n\n{table(found.work)}\n")
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
    print(f"\n## For the README\n\n{readme_table(studies)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
