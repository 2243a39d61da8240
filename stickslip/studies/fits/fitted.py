"""The result of a fit: values with which a scene moves as measured, how well they are known, and the residuals."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.scene import Scene
from stickslip.simulation.result import Result
from stickslip.studies.fits.measurements import Measured

_POOR = 0.5  # a standard error larger than this part of a value says that it is not determined


@dataclass(frozen=True)
class Record:
    """The measurements of one run, beside the motion of the fitted scene.

    Attributes
    ----------
    name : str
        ``"records[0]"`` and so on where there are several, else empty.
    scene : Scene
        The scene with the fitted values.
    result : Result
        Its motion.
    measured : tuple of Measured
    """

    name: str
    scene: Scene = field(repr=False)
    result: Result = field(repr=False)
    measured: tuple[Measured, ...] = field(repr=False)

    def label(self, one: Measured) -> str:
        """Return the name of a measured quantity among all records."""
        return f"{self.name}.{one.name}" if self.name else one.name


@dataclass(frozen=True, eq=False)
class Fit:
    """Parameters that make a scene move as measured.

    Attributes
    ----------
    parameters : tuple of str
    values : array (p,)
        In SI units, those of `units`.
    units : tuple of str
    covariance : array (p, p)
        Of the values: from the standard deviations of the noise where all are given, else from the residuals.
    records : tuple of Record
        For each record the scene with these values, its motion and what was measured.
    cost : float
        Half of the sum of the squares of the weighted residuals.
    starts : tuple of (array, float)
        Where each start of the search ended, and its cost there; best first.
    reasons : tuple of str
        Where derivatives do not exist at the solution.
    at_bounds : tuple of str
        Parameters that end at one of their bounds.
    """

    parameters: tuple[str, ...]
    values: Array
    units: tuple[str, ...]
    covariance: Array = field(repr=False)
    records: tuple[Record, ...] = field(repr=False)
    cost: float
    starts: tuple[tuple[Array, float], ...] = field(repr=False)
    reasons: tuple[str, ...]
    at_bounds: tuple[str, ...]

    @property
    def scene(self) -> Scene:
        """The scene with these values; of several records the first."""
        return self.records[0].scene

    @property
    def result(self) -> Result:
        """The motion of that scene."""
        return self.records[0].result

    @property
    def measured(self) -> tuple[Measured, ...]:
        """All that was measured, one record after another."""
        return tuple(one for record in self.records for one in record.measured)

    @property
    def standard_errors(self) -> Array:
        """Standard deviations of the values; infinite where the data do not depend on one."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def correlation(self) -> Array:
        """Correlations of the values."""
        errors = self.standard_errors
        with np.errstate(invalid="ignore"):
            return np.asarray(self.covariance / np.outer(errors, errors))

    @property
    def determined(self) -> dict[str, bool]:
        """Whether the standard error of each value is less than half of it."""
        good = self.standard_errors <= _POOR * np.abs(self.values)
        return dict(zip(self.parameters, good.tolist(), strict=True))

    @property
    def misfit(self) -> float:
        """Size of the residuals over the standard deviations of the noise; NaN where none are given."""
        if any(one.sigma is None for one in self.measured):
            return float("nan")
        return float(np.sqrt(2 * self.cost / self._freedom))

    @property
    def fits(self) -> bool | None:
        """Whether the residuals are no larger than noise makes them, to five standard deviations.

        None where no standard deviations are given: nothing tells how large the noise is.
        """
        if np.isnan(self.misfit):
            return None
        return bool(self.misfit**2 <= 1 + 5 * np.sqrt(2 / self._freedom))

    @property
    def _freedom(self) -> int:
        """Degrees of freedom: how many more values were measured than parameters fitted, at least 1."""
        return max(sum(one.t.size for one in self.measured) - self.values.size, 1)

    def residuals(self) -> dict[str, Array]:
        """Return what was measured less what the fitted scene does, by the names of the data.

        Of several records they are called ``"records[0].BODY.velocity"`` and so on.
        """
        return {
            record.label(one): one.values - one.read(record.result)
            for record in self.records
            for one in record.measured
        }

    def plot(self, *, axes: Any = None) -> Any:
        """Draw what was measured, what the fitted scene does, and the residuals; return the figure."""
        from stickslip import plots

        return plots.fit(self, axes=axes)

    def __str__(self) -> str:
        """Return values with their standard errors and units, and what is poorly determined."""
        width = max(map(len, self.parameters))
        lines = []
        told = zip(self.parameters, self.values, self.standard_errors, self.units, strict=True)
        for name, value, error, unit in told:
            poor = "" if self.determined[name] else "  (not determined by these data)"
            poor += "  (at its bound)" if name in self.at_bounds else ""
            lines.append(f"{name.ljust(width)}  {value:.8g} +- {error:.2g} {unit}{poor}".rstrip())
        correlation = np.abs(np.nan_to_num(self.correlation)) - np.eye(len(self.parameters))
        i, k = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
        if correlation[i, k] > 0.9:
            lines.append(
                f"{self.parameters[i]} and {self.parameters[k]} are told apart poorly: "
                f"correlation {self.correlation[i, k]:.3f}"
            )
        if self.fits is None:
            sizes = (f"{name} {np.sqrt(np.mean(off**2)):.2g}" for name, off in self.residuals().items())
            lines.append(
                f"root mean squares of the residuals: {', '.join(sizes)}; sigma would tell whether the scene fits"
            )
        elif not self.fits:
            lines.append(
                f"the residuals are {self.misfit:.3g} times as large as the given sigma: the scene does not move as "
                "measured, and the standard errors mean nothing; look at the units, the first guess and the model"
            )
        return "\n".join([*lines, *self.reasons])
