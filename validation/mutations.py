"""`python -m validation.mutations`: the solver broken on purpose, in many ways, to see whether the table notices.

Each mutation replaces a part of the package in a process of its own; rows that pass on the sound package must then
fail. A mutation that no row notices has survived, and is a hole in the table.
"""

from __future__ import annotations

import argparse
import pkgutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from validation.__main__ import table
from validation.rows import Row
from validation.runner import run

ENOUGH = 3  # rows that must notice before the next mutation is tried
_LEFT_OUT = (
    "*/multiplier",
    "events-*",
    "chain-100*",
    "units*",
    "pre-slip-*",
    "lugre",
)


Change = Callable[[Any], Any]


@dataclass(frozen=True)
class Mutation:
    """A way to break the package: replaces an attribute, named as module:object, by the result of `change`."""

    name: str
    what: str
    target: str
    change: Change


MUTATIONS: list[Mutation] = []


def breaks(name: str, what: str, target: str) -> Callable[[Change], Change]:
    """Enter a way to break the package: the decorated function returns a replacement of the original."""

    def enter(change: Change) -> Change:
        MUTATIONS.append(Mutation(name, what, target, change))
        return change

    return enter


def apply(name: str) -> None:
    """Break the package here, for good."""
    (mutation,) = (m for m in MUTATIONS if m.name == name)
    owner, _, last = mutation.target.replace(":", ".").rpartition(".")
    setattr(pkgutil.resolve_name(owner), last, mutation.change(pkgutil.resolve_name(mutation.target)))


# The replacements


@breaks("eq1-sign", "eq. (1) with the wrong sign", "stickslip.equations.balance:Balance.held_forces")
def _negated(original: Any) -> Any:
    return lambda *args, **options: -original(*args, **options)


def _returning(value: Any) -> Change:
    return lambda original: lambda *args, **options: value


breaks("margin-off", "relaxation is never found", "stickslip.events.rest:_first_rest")(_returning(None))
breaks("margin-alone", "inside the margin is at rest", "stickslip.events.rest:_at_rest")(_returning(True))
breaks("never-released", "overloaded contacts are held all the same", "stickslip.events.search:Search._improved")(
    _returning(None)
)
breaks("looks-off-steps", "no look between computed points", "stickslip.engines.solvers.follow:first_dip")(
    _returning(None)
)


@breaks("step-limit-off", "series are used beyond their step limit", "stickslip.engines.series:Series._step_limit")
def _no_step_limit(original: Any) -> Any:
    return staticmethod(_returning(1.0)(original))


def _after(change: Callable[[Any], None]) -> Change:
    """Return a replacement that runs the original and then changes its object."""

    def replacement(original: Any) -> Any:
        def changed(self: Any, *args: Any, **options: Any) -> Any:
            answer = original(self, *args, **options)
            change(self)
            return answer

        return changed

    return replacement


@breaks("static-slip", "slipping friction at the static level", "stickslip.model.laws.table:LawTable.__init__")
@_after
def _static_while_slipping(coefficients: Any) -> None:
    coefficients.mu_c = coefficients.mu_s.copy()


@breaks("dwell-off", "the static level is there at once", "stickslip.equations.system:System._place_laws")
@_after
def _no_rise(system: Any) -> None:
    system.rise[:] = 0.0


@breaks("normal-frozen", "the level keeps the old normal force", "stickslip.equations.guards.guards:Guards.series")
def _frozen_normal(original: Any) -> Any:
    """The guards of held contacts do not see that their normal forces change."""

    def changed(self: Any, expansion: Any) -> Any:
        found = original(self, expansion)
        found[1:] -= self.rows.mu * expansion.q[1:, self.rows.row]
        return found

    return changed


@breaks("t-start-old", "dwell counted from the start of the run", "stickslip.equations.motion:Motion.__init__")
def _since_the_start(original: Any) -> Any:
    def changed(self: Any, equations: Any, stretch: Any, t: float, y: Any, since: Any) -> None:
        original(self, equations, stretch, t, y, np.minimum(since, 0.0))

    return changed


@breaks("dwell-restarts", "dwell starts anew at every event", "stickslip.equations.motion:Motion.__init__")
def _since_now(original: Any) -> Any:
    def changed(self: Any, equations: Any, stretch: Any, t: float, y: Any, since: Any) -> None:
        original(self, equations, stretch, t, y, np.full_like(since, t))

    return changed


@breaks("one-by-one", "overloaded contacts are let go with old forces", "stickslip.events.search:Search._ratios")
def _first_come(original: Any) -> Any:
    """Every overloaded contact counts as overloaded as any other: all are let go with the forces they had."""
    return lambda self, *args: np.ones_like(original(self, *args))


@breaks("none-spared", "in loops, the first to reach its level moves", "stickslip.events.search:Search._spared")
def _none_spared(original: Any) -> Any:
    return lambda self, *args: np.zeros_like(original(self, *args))


@breaks("deflation-off", "guards start at 0 undivided", "stickslip.equations.guards.guards:Guards._classify")
@_after
def _no_zeros(guards: Any) -> None:
    guards.order[:] = 0


@breaks(
    "projection-heaviest",
    "bodies lock at the velocity of the heaviest",
    "stickslip.equations.balance:Balance.project",
)
def _as_the_heaviest(original: Any) -> Any:
    return lambda self, v, u: self.consistent(v, u)


@breaks("norm", "forces in loops are not the shortest", "stickslip.equations.balance:_Component._least_norm")
def _weighted_norm(original: Any) -> Any:
    """Forces in loops that hold the motion as well, but are not the shortest."""

    def changed(self: Any, inertia: Any, D: Any, null: Any, scale: Any) -> None:
        original(self, inertia, D, null, scale * np.arange(1, scale.size + 1))

    return changed


@breaks("shares", "groups accelerate as if all were heavy", "stickslip.equations.balance:Balance._finish")
def _equal_shares(original: Any) -> Any:
    """Light members of a group count as heavy as the mean."""

    def changed(self: Any) -> None:
        own, self._inertia = self._inertia, np.maximum(self._inertia, self._inertia.mean())
        original(self)
        self._inertia = own

    return changed


@breaks(
    "drives-steady",
    "what a drive holds does not feel it accelerate",
    "stickslip.equations.balance:Balance.accelerations",
)
def _no_drives(original: Any) -> Any:
    return lambda self, forces, drives=None: original(self, forces, None)


@breaks("one-sided", "no breakaway backwards", "stickslip.equations.guard_rows:GuardRows.__init__")
@_after
def _one_sided(rows: Any) -> None:
    """The lower breakaway level is never reached."""
    lower = (rows.direction < 0) & ~rows.is_velocity
    rows.constant[lower] += 1e6
    rows.has_constant |= lower.any()


@breaks("straight-lines", "linear interpolation of outputs", "stickslip.results.steps:values")
def _straight(original: Any) -> Any:
    def changed(coefficients: Any, step: Any, s: Any, *rest: Any, **how: Any) -> Any:
        first, last = (original(coefficients, step, np.full_like(s, end), *rest, **how) for end in (0.0, 1.0))
        return first + s[:, None] * (last - first)

    return changed


@breaks("projection-off", "velocities are not joined on locking", "stickslip.equations.system:System.with_held")
def _untouched(original: Any) -> Any:
    return lambda system, y, u, held: y


@breaks("kinks-missed", "load breaks are stepped over", "stickslip.equations.loads.loads:Loads.next_break")
def _to_the_end(original: Any) -> Any:
    return lambda self, t, stop: stop


@breaks("looks-off-series", "double crossings within a series are missed", "stickslip.engines.series:first_root")
def _by_sign(original: Any) -> Any:
    """Roots are looked for where the signs at both ends of a step differ, and only there."""
    return lambda c, *floor: original(c, *floor) if c.sum() < 0 else None


@breaks("never-stuck", "contacts that come to rest are not found at rest", "stickslip.simulation.run:at_limit")
def _not_touching(original: Any) -> Any:
    """A contact whose velocity has come to 0 goes on with what is left of it."""

    def changed(*args: Any) -> Any:
        found = original(*args)
        return found._replace(touching=np.zeros_like(found.touching))

    return changed


@breaks("open-by-velocity", "open contacts at rest do not show where they go", "stickslip.events.labels:_to_come")
def _by_velocity(original: Any) -> Any:
    return lambda motion, named, w, *rest: (np.sign(w), original(motion, named, w, *rest)[1])


@breaks("curve-flat", "no Stribeck curve", "stickslip.model.laws.kinetic:Kinetic.__call__")
def _level(original: Any) -> Any:
    return lambda self, w: np.broadcast_to(self._of_side(self._level, w), w.shape)


def watched() -> list[Row]:
    """Return the rows that watch: quick ones, each with a short limit; the cheapest chapters first."""
    rows = [row for row in table(1, quick=True) if not any(fnmatchcase(row.name, name) for name in _LEFT_OUT)]
    order = (
        "Closed forms",
        "Extremes",
        "Published results",
        "Engines against each other",
        "Conservation",
        "Oracle",
    )
    rows = [row for row in rows if row.theme in order]
    return [replace(row, limit=30.0) for row in sorted(rows, key=lambda row: order.index(row.theme))]


def main(arguments: Sequence[str] | None = None) -> int:
    """Try the mutations; return 1 if one survives."""
    parser = argparse.ArgumentParser("python -m validation.mutations", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="mutations to try; all by default")
    names = parser.parse_args(arguments).names
    chosen = [m for m in MUTATIONS if not names or m.name in names]
    if not chosen or len(chosen) < len(set(names)):
        print(f"known mutations: {', '.join(m.name for m in MUTATIONS)}", file=sys.stderr)
        return 2
    rows = watched()
    sound = [o.row for o in tqdm(run(rows), total=len(rows), desc="sound", leave=False) if o.passed]
    print(f"{len(sound)} rows watch; each mutation is tried until {ENOUGH} notice\n")
    survived = []
    for mutation in chosen:
        noticed = noticing(mutation, sound)
        if not noticed:
            survived.append(mutation.name)
        seen = ", ".join(noticed) if noticed else "SURVIVES"
        print(f"{mutation.name:20s} {mutation.what:50s} {seen}", flush=True)
    print(f"\n{len(chosen)} mutations: {len(chosen) - len(survived)} noticed, {len(survived)} survive")
    return 1 if survived else 0


def noticing(mutation: Mutation, rows: Sequence[Row]) -> list[str]:
    """Return the names of the first rows that fail under a mutation."""
    noticed: list[str] = []
    outcomes = run(rows, prepare=partial(apply, mutation.name))
    for outcome in tqdm(outcomes, total=len(rows), desc=mutation.name, leave=False):
        if outcome.error == np.inf and outcome.remark.startswith(("AttributeError", "TypeError", "ImportError")):
            raise SystemExit(f"{mutation.name} does not fit the package any more: {outcome.remark}")
        if not outcome.passed:
            noticed.append(outcome.row.name)
        if len(noticed) == ENOUGH:
            break
    outcomes.close()
    return noticed


if __name__ == "__main__":
    sys.exit(main())
