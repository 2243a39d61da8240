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
    Karnopp,
    LuGre,
    Result,
    Scene,
    Spring,
    simulate,
)
from stickslip.studies.tradeoff import Tradeoff, tradeoff
from stickslip.studies.work_precision import Setup, WorkPrecision, WorkRow, work_precision
from validation.exact import Story, reference, two_flywheels

LEVELS = (1e-1, 1e-2, 1e-3, 1e-6, 1e-9)
BANDS = (1e-1, 1e-2, 1e-3, 1e-4)
"""Dead bands and bristle velocities, as parts of the velocity scale, of the laws that `tradeoff` does not try."""
STEPS = {"contact force": (1000, 3000, 10_000, 30_000, 100_000), "pre-slip": (30_000, 100_000, 300_000)}
"""Numbers of steps of the comparison at fixed steps; fewer make the pre-slip model unstable."""
PRE_SLIP = 1e-3
"""Pre-slip velocity in rad/s of the comparison at fixed steps: the paper's, table 1."""


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


def cases() -> list[Case]:
    """Return the scenes."""
    benchmark, viscous = two_flywheels(), reference("flywheels-4-viscous")
    return [
        Case(
            "benchmark", "flywheel benchmark", benchmark.scene, (0.0, benchmark.stop), benchmark, level=20.0
        ),
        Case("viscous", "four viscous flywheels", viscous.scene, (0.0, viscous.stop), viscous, level=12.0),
        Case("leine", "Leine's belt", leines_belt(), (0.0, 40.0)),
        Case("blocks", "50 blocks on a belt", blocks(50), (0.0, 5.0), weight=3.0, level=1.75),
    ]


def exact_error(story: Story) -> Callable[[Result], float]:
    """Return the largest deviation from an exact answer as an error function."""
    names = [body.name for body in story.scene.bodies]
    rows = [names.index(name) for name in story.bodies]

    def error(result: Result) -> float:
        return float(np.abs(result(story.t)[rows].T - story.velocities).max())

    return error


def against(case: Case) -> Callable[[Result], float]:
    """Return the largest deviation from a tight run as an error function."""
    count, times = len(case.scene.bodies), np.linspace(*case.span, 1001)
    exact = simulate(case.scene, case.span, rtol=1e-11, atol=1e-13)(times)[:count]
    return lambda result: float(np.abs(result(times)[:count] - exact).max())


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
    """Return the shortest time in ms within an error; or, in brackets, the smallest error reached."""
    times = [row.median for row in rows if row.failure is None and row.error <= error]
    if times:
        return f"{1e3 * min(times):.3g}"
    errors = [row.error for row in rows if row.failure is None]
    return f"({min(errors):.0e})" if errors else "fails"


def table(work: WorkPrecision) -> str:
    """Return the times at some errors, one line per family, as Markdown.

    In brackets stands the smallest error of a family where it reaches no smaller one.
    """
    lines = ["| method | " + " | ".join(f"ms to {level:.0e}" for level in LEVELS) + " |"]
    lines.append("|---" * (1 + len(LEVELS)) + "|")
    grouped: dict[str, list[WorkRow]] = {}
    for row in work.rows:
        grouped.setdefault(row.family or row.name, []).append(row)
    for family, rows in grouped.items():
        lines.append("| " + " | ".join([family, *(time_for(rows, level) for level in LEVELS)]) + " |")
    return "\n".join(lines)


def failures(rows: Sequence[WorkRow]) -> list[str]:
    """Say why families of which no call succeeds do not."""
    reasons: dict[str, str] = {}
    for row in rows:
        family = row.family or row.name
        reasons[family] = "" if row.failure is None else reasons.get(family, row.failure)
    return [f"{family} fails: {reason}" for family, reason in reasons.items() if reason]


def other_laws(case: Case, found: Tradeoff, error: Callable[[Result], float]) -> WorkPrecision:
    """Measure LuGre's bristles, and Karnopp's dead band where contacts allow it, by BDF and with fixed steps."""
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
    return work_precision(setups, error=error, repeats=1, warmup=0, error_label=found.work.error_label)


def panels(studies: dict[str, Tradeoff], others: dict[str, WorkPrecision], file: Path) -> None:
    """Draw one small panel per scene: error against time; exact methods stand at the floor."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(studies), figsize=(4 * len(studies), 4.2), sharey=True)
    names: dict[str, int] = {}
    for ax, (title, found) in zip(np.atleast_1d(axes), studies.items(), strict=True):
        rows = [*found.work.rows, *others[title].rows]
        for family, group in families(WorkPrecision(tuple(rows))).items():
            number = names.setdefault(family, len(names))
            front = WorkPrecision(tuple(group)).pareto()
            ax.loglog(
                [1e3 * row.median for row in front],
                [min(max(row.error, 1e-14), 3.0) for row in front],
                ["-", "--", ":"][number // 10 % 3],
                marker="os^vD"[number % 5],
                markersize=3.5,
                linewidth=0.9,
                color=f"C{number % 10}",
                label=family,
            )
        ax.axhspan(1e-15, max(found.limit, 1e-14), color="0.9", zorder=0)
        ax.set(title=title, xlabel="CPU time / ms", ylim=(3e-15, 4.0))
        ax.grid(True, linewidth=0.3)
    np.atleast_1d(axes)[0].set_ylabel("largest velocity error / (m/s or rad/s)")
    handles = {}
    for ax in np.atleast_1d(axes):
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(handles.values(), handles.keys(), ncol=5, loc="lower center", fontsize=7, frameon=False)
    figure.tight_layout(rect=(0, 0.2, 1, 1))
    figure.savefig(file, dpi=110)


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
    studies: dict[str, Tradeoff] = {}
    others: dict[str, WorkPrecision] = {}
    for case in cases():
        try:
            found = study(case, case.weight * (20.0 if options.quick else 60.0))
        except ValueError as too_slow:
            print(f"\n## {case.title}\n\n{too_slow}")
            continue
        studies[case.title] = found
        error = exact_error(case.story) if case.story else against(case)
        others[case.title] = other_laws(case, found, error)
        judge = "exact answer" if case.story else f"reference converged to {found.limit:.1e}"
        print(
            f"\n## {case.title} ({judge})\n\n{table(WorkPrecision((*found.work.rows, *others[case.title].rows)))}\n"
        )
        print("\n".join(failures((*found.work.rows, *others[case.title].rows))))
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
    if options.figures:
        panels(studies, others, options.figures / "tradeoff-all.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
