"""The weighted residuals of all records, which a fit makes small, with their exact derivatives."""

from __future__ import annotations

import math
from itertools import chain
from typing import Any

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.scene import Scene
from stickslip.simulation.result import Result, SimulationError
from stickslip.studies.derivatives.directions import along_parameter
from stickslip.studies.derivatives.sensitivities import from_variation
from stickslip.studies.derivatives.variations import Variation, simulated
from stickslip.studies.fits.fitted import Fit, Record
from stickslip.studies.fits.measurements import Measured
from stickslip.studies.parameters import Parameter, with_values

REFUSED = 1e6  # weighted residual where a scene cannot be simulated
_NOTHING = 1e-150  # derivatives no larger than this are no effect: their squares are next to 0

# A value nearer to a bound than this part of the range between its bounds is at the bound: the search ends beside it.
_AT_BOUND = 1e-6


class RecordRun:
    """Weighted residuals of one record and their derivatives; its parameters by their places among all."""

    def __init__(
        self,
        label: str,
        scene: Scene,
        parameters: dict[int, Parameter],
        measured: tuple[Measured, ...],
        weights: list[Array],
        options: dict[str, Any],
    ) -> None:
        self._label, self._scene, self._measured, self._weights = label, scene, measured, weights
        self._places, self._parameters, self._options = list(parameters), list(parameters.values()), options
        self._stop = max(float(one.t[-1]) for one in measured)
        self._last: tuple[bytes, float, Result] | None = None
        self.refusal: Exception | None = None
        """Why a simulation failed, of the last values with which one did."""

    def _at(self, x: Array) -> list[Parameter]:
        """Return the parameters; a Coulomb coefficient beyond a static one that is not fitted takes this one along."""
        own = {(one.place, one.steps) for one in self._parameters}
        moved = [
            one.with_static(self._scene, value)
            for one, value in zip(self._parameters, x[self._places].tolist(), strict=True)
        ]
        return [one if (new.place, new.twin) in own else new for one, new in zip(self._parameters, moved, strict=True)]

    def _scene_at(self, x: Array) -> Scene:
        """Return the scene with other values."""
        return with_values(self._scene, self._at(x), x[self._places].tolist())

    def units(self, scene: Scene) -> dict[int, str]:
        """Return the units of the parameters by their places."""
        return {k: one.unit(scene) for k, one in zip(self._places, self._parameters, strict=True)}

    def record(self, x: Array) -> Record:
        """Return the record, with the scene at some values and its motion."""
        return Record(self._label, self._scene_at(x), self._result(x, 1.0), self._measured)

    def _result(self, x: Array, part: float) -> Result:
        """Return the motion with other values over a part of the time."""
        key, stop = x[self._places].tobytes(), part * self._stop
        if self._last is None or self._last[:2] != (key, stop):
            self._last = key, stop, simulated(self._scene_at(x), (0.0, stop), **self._options)
        return self._last[2]

    def _within(self, part: float) -> list[tuple[Measured, Array]]:
        """Return what was measured in a part of the time, and its weights."""
        counts = [int(np.searchsorted(one.t, part * self._stop, side="right")) for one in self._measured]
        return [
            (Measured(one.name, one.t[:count], one.values[:count], None), weight[:count])
            for one, weight, count in zip(self._measured, self._weights, counts, strict=True)
            if count
        ]

    def residuals(self, x: Array, part: float) -> Array:
        """Return the weighted residuals over a part of the time; large ones where it cannot be simulated."""
        some = self._within(part)
        try:
            result = self._result(x, part)
        except (ValueError, SimulationError) as error:
            self.refusal = error
            return np.full(sum(one.t.size for one, _ in some), REFUSED)
        return np.concatenate([np.empty(0), *((one.read(result) - one.values) * w for one, w in some)])

    def slopes(self, x: Array, part: float) -> tuple[Array, tuple[str, ...]]:
        """Return the derivatives of the weighted residuals, 0 where none exist, and why these do not."""
        result, some = self._result(x, part), self._within(part)
        scene = result.scene
        own = zip(self._at(x), x[self._places].tolist(), strict=True)
        directions = [along_parameter(scene, one.at(value), result.trajectory, "fit") for one, value in own]
        found = from_variation(Variation(result, directions))
        slopes = np.zeros((sum(one.t.size for one, _ in some), x.size))
        if some:
            read = [getattr(found, one.quantity)(one.of, one.t) * weight[:, None] for one, weight in some]
            slopes[:, self._places] = np.nan_to_num(np.concatenate(read))
        return slopes, found.reasons


class Problem:
    """Weighted residuals of all records and their derivatives, and the bounds of the parameters."""

    def __init__(self, names: list[str], bounds: tuple[Array, Array], runs: list[RecordRun], has_sigma: bool) -> None:
        self._names, self.bounds, self._runs, self._has_sigma = names, bounds, runs, has_sigma

    def residuals(self, x: Array, part: float) -> Array:
        """Return the weighted residuals over a part of the time; large ones where one cannot be simulated."""
        return np.concatenate([run.residuals(x, part) for run in self._runs])

    @property
    def refusal(self) -> str:
        """Why some values could not be simulated."""
        return next((str(run.refusal) for run in self._runs if run.refusal is not None), "")

    def simulate(self, x: Array) -> None:
        """Simulate all records; the error says what cannot be simulated."""
        for run in self._runs:
            run.record(x)

    def slopes(self, x: Array, part: float) -> Array:
        """Return the derivatives of the weighted residuals, 0 where none exist."""
        return np.concatenate([run.slopes(x, part)[0] for run in self._runs])

    def fitted(self, x: Array, ends: tuple[tuple[Array, float], ...]) -> Fit:
        """Return the fit at a solution."""
        residuals = self.residuals(x, 1.0)
        parts, reasons = zip(*(run.slopes(x, 1.0) for run in self._runs), strict=True)
        slopes = np.concatenate(parts)
        cost, freedom = 0.5 * float(residuals @ residuals), residuals.size - x.size
        spread = 1.0 if self._has_sigma else 2 * cost / max(freedom, 1)
        effect = np.linalg.norm(slopes, axis=0)
        # each value is measured by its effect on the residuals, not by its size, which may be 0
        size = 1.0 / np.where(effect > _NOTHING, effect, math.inf)
        _, sizes, lines = np.linalg.svd(slopes * size, full_matrices=False)
        lost = sizes <= 1e-12 * sizes.max(initial=0.0)
        inverse = np.where(lost, 0.0, 1.0 / np.where(lost, 1.0, sizes) ** 2)
        covariance = (lines.T * inverse) @ lines * np.outer(size, size) * spread
        blind = (np.abs(lines[lost]) > 1e-6).any(axis=0)
        covariance[blind, blind] = np.inf
        if not (freedom or self._has_sigma):
            # with as many parameters as values the residuals are 0, whatever the noise
            covariance[:] = np.inf
            said = f"{residuals.size} values and as many parameters leave no standard errors; give sigma or more data"
            reasons = ((said,), *reasons)
        records = [run.record(x) for run in self._runs]
        units: dict[int, str] = {}
        for run, record in zip(self._runs, records, strict=True):
            units |= run.units(record.scene)
        return Fit(
            tuple(self._names),
            x,
            tuple(units[k] for k in range(x.size)),
            covariance,
            tuple(records),
            cost,
            ends,
            tuple(dict.fromkeys(chain(*reasons))),
            tuple(name for name, is_at in zip(self._names, self._at_bounds(x), strict=True) if is_at),
        )

    def _at_bounds(self, x: Array) -> list[bool]:
        """Tell which values lie at a bound, as near as the search comes to it."""
        low, high = self.bounds
        size = np.where(np.isfinite(high - low), high - low, np.abs(x))
        return [bool(is_at) for is_at in np.minimum(x - low, high - x) <= _AT_BOUND * size]
