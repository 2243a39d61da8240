"""A sweep over the numbers of a scene: which of them vary, and what is read of each run."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results.units import units
from stickslip.simulation.arguments import Times
from stickslip.simulation.result import Result
from stickslip.simulation.simulate import simulate
from stickslip.studies.parameters import named_parameters, with_values

_MOST = 10**7  # values of one field


@dataclass(frozen=True, eq=False)
class SceneRuns:
    """Runs of a scene with some of its numbers changed: what `sweep` evaluates at each point."""

    scene: Scene
    t_span: Times  # start and end in s
    options: Mapping[str, Any]  # arguments of `simulate`

    @property
    def version(self) -> str:
        """A text that identifies the scene, the time span and the options."""
        return json.dumps([self.scene.to_dict(), self.t_span, dict(self.options)], default=list)

    def at(self, point: Mapping[str, float]) -> Scene:
        """Return the scene with the numbers of a point: ``floor.normal``, ``springs[0].stiffness`` and the like."""
        return with_values(
            self.scene, named_parameters(self.scene, list(point), "sweep", together=True), list(point.values())
        )

    def __call__(self, **point: float) -> dict[str, float]:
        """Simulate one point; return events, last velocities, and of each contact its stuck part and its heat."""
        result = simulate(self.at(point), self.t_span, **self.options)
        return dict(zip(self.values, _read(result), strict=True))

    def check(self, grid: Mapping[str, Sequence[float]]) -> None:
        """Raise a ValueError if the scene has no such numbers, or the first refusal if no point is valid."""
        parameters = named_parameters(self.scene, list(grid), "sweep", together=True)
        first: ValueError | None = None
        for point in itertools.product(*grid.values()):
            try:
                with_values(self.scene, parameters, list(point))
            except ValueError as refusal:
                first = first or refusal
            else:
                return
        if first is not None:
            raise first

    @property
    def values(self) -> list[str]:
        """The names of the values of a point, in the order in which they are read."""
        rows = self.scene.contacts
        found = ["events", *(f"velocity {body.name}" for body in self.scene.bodies)]
        return [*found, *(f"{what} {row.name}" for what in ("stuck", "heat") for row in rows)]

    def unit(self, name: str) -> str:
        """Return the unit of a value or a parameter, or an empty text where it has none or is not known."""
        bodies = {f"velocity {body.name}": body for body in self.scene.bodies}
        if name in bodies:
            return units(self.scene, bodies[name]).velocity
        if name == "events" or name.startswith(("stuck ", "heat ")):
            return "J" if name.startswith("heat ") else ""
        return named_parameters(self.scene, [name], "sweep")[0].unit(self.scene)


def values_of(text: str) -> list[float]:
    """Return the values that a text lists: ``1,2,5``, or ``START:STOP:COUNT`` evenly, or with ``:log`` in ratios."""
    try:
        if ":" not in text:
            return [float(part) for part in text.split(",")]
        start, stop, count, *rest = text.split(":")
        if rest not in ([], ["log"]) or not 1 <= int(count) <= _MOST:
            raise ValueError
        ends = float(start), float(stop)
        with np.errstate(all="ignore"):
            spaced = np.geomspace(*ends, int(count)) if rest else np.linspace(*ends, int(count))
    except ValueError:
        raise ValueError(
            f"{text!r} lists no values, or more than {_MOST:g}; "
            "write 0.1,0.2,0.5 or START:STOP:COUNT such as 0:1:11, or 0.01:1:9:log"
        ) from None
    if not all(map(math.isfinite, spaced)):
        raise ValueError(f"{text!r} lists values that are not finite; with :log both ends must be positive")
    return [float(value) for value in spaced]


def _read(result: Result) -> list[float]:
    """Return the values of a run whose names are `SceneRuns.values`."""
    scene, heat = result.scene, result.energy().contacts
    return [
        float(len(result.events)),
        *(result.velocity(body.name)[-1] for body in scene.bodies),
        *(result.share(row.name)[Mode.STUCK] for row in scene.contacts),
        *(heat[row.name][-1] for row in scene.contacts),
    ]
