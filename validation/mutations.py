"""`python -m validation.mutations`: the solver broken on purpose, in many ways, to see whether the table notices.

Each mutation replaces a part of the package in a process of its own; rows that pass on the sound package must then
fail. A mutation that no row notices has survived, and is a hole in the table.

With `--generate N` it makes N small changes of the source instead, drawn from the syntax tree, and has the tests watch:
those that run the changed function, each change in a scratch copy. What survives is a hole in the tests, or harmless.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from validation.__main__ import table
from validation.rows import Row
from validation.runner import run
from validation.survivors import Trial, try_generated

ENOUGH = 3
"""Rows that must notice before the next mutation is tried."""
_WATCHED = ("*/contact-force", "relaxation/*", "[a-z]*-*")
_LEFT_OUT = (
    "*/merged",
    "*/multiplier",
    "events-*",
    "chain-100*",
    "random-*",
    "refuses-*",
    "units*",
    "pre-slip-*",
    "lugre",
)


@dataclass(frozen=True)
class Mutation:
    """A way to break the package: replaces an attribute, named as module:object, by what `change` makes of it."""

    name: str
    what: str
    target: str
    change: Callable[[Any], Any]


def apply(name: str) -> None:
    """Break the package here, for good."""
    for mutation in MUTATIONS:
        if mutation.name == name:
            module, path = mutation.target.split(":")
            owner: Any = importlib.import_module(module)
            *parents, last = path.split(".")
            for parent in parents:
                owner = getattr(owner, parent)
            setattr(owner, last, mutation.change(getattr(owner, last)))


# What a part is replaced by


def _negated(original: Any) -> Any:
    return lambda *args, **options: -original(*args, **options)


def _returning(value: Any) -> Any:
    return lambda original: lambda *args, **options: value


def _after(change: Callable[[Any], None]) -> Any:
    """Return a replacement that runs the original and then changes its object."""

    def replacement(original: Any) -> Any:
        def changed(self: Any, *args: Any, **options: Any) -> Any:
            answer = original(self, *args, **options)
            change(self)
            return answer

        return changed

    return replacement


def _static_while_slipping(coefficients: Any) -> None:
    coefficients.mu_c = coefficients.mu_s.copy()


def _frozen_normal(original: Any) -> Any:
    """The guards of stuck contacts do not see that their normal forces change."""

    def changed(self: Any, y: Any, q0: Any, q1: Any) -> Any:
        found = original(self, y, q0, q1)
        return found._replace(c1=found.c1 - self.guard_levels * q1[self.guard_inputs])

    return changed


def _since_the_start(original: Any) -> Any:
    def changed(self: Any, system: Any, mode_set: Any, t: float, y: Any, since: Any, *rest: Any) -> None:
        original(self, system, mode_set, t, y, np.minimum(since, 0.0), *rest)

    return changed


def _since_now(original: Any) -> Any:
    def changed(self: Any, system: Any, mode_set: Any, t: float, y: Any, since: Any, *rest: Any) -> None:
        original(self, system, mode_set, t, y, np.full_like(since, t), *rest)

    return changed


def _first_come(original: Any) -> Any:
    """Every overloaded contact counts as overloaded as any other: all are let go with the forces they had."""
    return lambda self, *args: np.ones_like(original(self, *args))


def _no_zeros(original: Any) -> Any:
    def changed(self: Any, fired: Any) -> Any:
        violated, order = original(self, fired)
        return violated, np.zeros_like(order)

    return changed


def _plain_mean(original: Any) -> Any:
    """Joined bodies take the mean of their velocities, whatever they weigh."""

    def changed(system: Any, y: Any, q: Any, joined: Any) -> Any:
        out = original(system, y, q, joined)
        for j in np.flatnonzero(joined):
            a, b = system.a[j], system.b[j]
            if a < system.n and b < system.n:
                out[a] = out[b] = 0.5 * (y[a] + y[b])
        return out

    return changed


def _weighted_norm(original: Any) -> Any:
    """Forces in loops that hold the motion as well, but are not the shortest."""

    def changed(self: Any, *args: Any) -> Any:
        forces = original(self, *args)
        g = self._incidence.toarray()
        weighted = g / np.arange(1, g.shape[0] + 1)[:, None]
        return weighted @ np.linalg.pinv(g.T @ weighted) @ (g.T @ forces)

    return changed


def _equal_shares(original: Any) -> Any:
    """Members of a group share its force by number, not by inertia."""

    def changed(self: Any, forces: Any) -> Any:
        inertia, self.mass = self.mass, self.mass * 1.0
        self.mass = np.maximum(self.mass, self.mass.mean())
        answer = original(self, forces)
        self.mass = inertia
        return answer

    return changed


def _one_sided(original: Any) -> Any:
    """The lower breakaway level is never reached."""

    def changed(self: Any, tau: Any, z: Any) -> Any:
        g = original(self, tau, z)
        g[self.slips + self.helds :] += 1e6
        return g

    return changed


def _straight(original: Any) -> Any:
    def changed(points: Any, query: Any) -> Any:
        return np.column_stack([np.interp(query, points.taus, column) for column in points.states.T])

    return changed


def _untouched(original: Any) -> Any:
    return lambda system, y, q, joined: y


def _to_the_end(original: Any) -> Any:
    return lambda self, t, stop: stop


def _whole_horizon(original: Any) -> Any:
    return lambda segment, horizon, max_step: horizon


def _sticky(original: Any) -> Any:
    """A contact that comes to rest is tried in its old mode, not stuck."""

    def changed(system: Any, t: float, y: Any, modes: Any, since: Any, touching: Any, *rest: Any) -> Any:
        return original(system, t, y, modes, since, np.zeros_like(touching), *rest)

    # nor where it alone changes
    importlib.import_module("stickslip.simulation.simulate").change_one = _returning(None)(None)  # type: ignore[attr-defined]
    return changed


MUTATIONS = (
    Mutation("eq1-sign", "eq. (1) with the wrong sign", "stickslip.grouping:Groups.contact_forces", _negated),
    Mutation(
        "t-start-old",
        "dwell counted from the start of the run",
        "stickslip.guards:Guarded.__init__",
        _since_the_start,
    ),
    Mutation(
        "dwell-restarts", "dwell starts anew at every event", "stickslip.guards:Guarded.__init__", _since_now
    ),
    Mutation(
        "dwell-off", "the static level is there at once", "stickslip.guards:Guarded._lag", _returning(0.0)
    ),
    Mutation(
        "margin-off",
        "relaxation is never found",
        "stickslip.segment:Segment.has_come_to_rest",
        _returning(False),
    ),
    Mutation(
        "margin-alone",
        "inside the margin is at rest",
        "stickslip.segment:Segment.has_come_to_rest",
        _returning(True),
    ),
    Mutation(
        "projection-off", "velocities are not joined on locking", "stickslip.transitions:project", _untouched
    ),
    Mutation(
        "projection-mean", "bodies lock at their mean velocity", "stickslip.transitions:project", _plain_mean
    ),
    Mutation(
        "one-by-one",
        "overloaded contacts are let go with old forces",
        "stickslip.transitions:_Search._ratios",
        _first_come,
    ),
    Mutation("kinks-missed", "load breaks are stepped over", "stickslip.equations.loads:Loads.next_break", _to_the_end),
    Mutation(
        "static-slip",
        "slipping friction at the static level",
        "stickslip.model.laws.kernels:Coefficients.__init__",
        _after(_static_while_slipping),
    ),
    Mutation(
        "normal-frozen",
        "the level keeps the old normal force",
        "stickslip.mode_set_dense:DenseModeSet.expand",
        _frozen_normal,
    ),
    Mutation("deflation-off", "guards start at 0 undivided", "stickslip.segment:Segment.classify", _no_zeros),
    Mutation(
        "looks-off-steps", "no look between computed points", "stickslip.engine:first_dip", _returning(None)
    ),
    Mutation(
        "looks-off-parabolas",
        "no look between ends of parabolas",
        "stickslip.engine:first_violation",
        _whole_horizon,
    ),
    Mutation(
        "norm",
        "forces in loops are not the shortest",
        "stickslip.grouping:Groups._least_norm",
        _weighted_norm,
    ),
    Mutation(
        "shares", "groups accelerate as if all were heavy", "stickslip.grouping:Groups.mean", _equal_shares
    ),
    Mutation("one-sided", "no breakaway backwards", "stickslip.guards:Guarded.raw_guards", _one_sided),
    Mutation("straight-lines", "linear interpolation of outputs", "stickslip.pieces:read_off", _straight),
    Mutation(
        "never-stuck",
        "contacts that come to rest are not found at rest",
        "stickslip.simulation.simulate:settle",
        _sticky,
    ),
)


def watched() -> list[Row]:
    """Return the rows that watch: quick ones, each with a short limit; the cheapest chapters first."""
    rows = [row for row in table(1, quick=True) if not any(fnmatchcase(row.name, name) for name in _LEFT_OUT)]
    order = ("Closed forms", "Extremes", "Published results", "Conservation", "Oracle")
    rows = [row for row in rows if row.theme in order]
    return [replace(row, limit=30.0) for row in sorted(rows, key=lambda row: order.index(row.theme))]


def main(arguments: Sequence[str] | None = None) -> int:
    """Try the mutations; return 1 if one survives."""
    parser = argparse.ArgumentParser("python -m validation.mutations", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="mutations to try; all by default")
    parser.add_argument(
        "--generate", type=int, metavar="N", help="make N changes of the source for the tests"
    )
    parser.add_argument("--seed", type=int, default=0, help="which changes to make (default 0)")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="files to change, such as '*/plots*'")
    parser.add_argument(
        "--limit", type=float, default=30.0, help="seconds that the tests of one change may take (default 30)"
    )
    parser.add_argument("--slow", action="store_true", help="let slow tests watch too")
    parser.add_argument(
        "--keep", type=Path, metavar="FILE", help="keep here which test runs what, and read it"
    )
    options = parser.parse_args(arguments)
    if options.generate is not None:
        if options.names:
            parser.error("--generate makes changes of its own; leave the names out")
        return _generate(options)
    names = options.names
    chosen = [m for m in MUTATIONS if not names or m.name in names]
    if not chosen or len(chosen) < len(set(names)):
        print(f"known mutations: {', '.join(m.name for m in MUTATIONS)}", file=sys.stderr)
        return 2
    rows = watched()
    sound = [o.row for o in tqdm(run(rows), total=len(rows), desc="sound", leave=False) if o.passed]
    print(f"{len(sound)} rows watch; each mutation is tried until {ENOUGH} notice\n")
    survived = []
    for mutation in chosen:
        noticed = _noticed(mutation, sound)
        if not noticed:
            survived.append(mutation.name)
        seen = ", ".join(noticed) if noticed else "SURVIVES"
        print(f"{mutation.name:20s} {mutation.what:50s} {seen}", flush=True)
    print(f"\n{len(chosen)} mutations: {len(chosen) - len(survived)} noticed, {len(survived)} survive")
    return 1 if survived else 0


def _generate(options: argparse.Namespace) -> int:
    """Try generated changes; return 1 if one survives."""
    tests = ["tests"] if options.slow else ["tests", "-m", "not slow"]
    trials: list[Trial] = []
    for trial in try_generated(
        options.generate, options.seed, options.only, tests, options.limit, options.keep
    ):
        trials.append(trial)
        print(trial, flush=True)
    survivors = [trial for trial in trials if trial.survived]
    print(f"\n{len(trials)} changes: {len(trials) - len(survivors)} noticed, {len(survivors)} survive")
    for trial in survivors:
        print(f"  {trial.change}")
    return 1 if survivors else 0


def _noticed(mutation: Mutation, rows: Sequence[Row]) -> list[str]:
    noticed: list[str] = []
    outcomes = run(rows, prepare=partial(apply, mutation.name))
    for outcome in tqdm(outcomes, total=len(rows), desc=mutation.name, leave=False):
        if outcome.error == np.inf and outcome.remark.startswith(
            ("AttributeError", "TypeError", "ImportError")
        ):
            raise SystemExit(f"{mutation.name} does not fit the package any more: {outcome.remark}")
        if not outcome.passed:
            noticed.append(outcome.row.name)
        if len(noticed) == ENOUGH:
            break
    outcomes.close()
    return noticed


if __name__ == "__main__":
    sys.exit(main())
