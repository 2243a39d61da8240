"""What a fit is: numbers with which a scene moves as measured, how well they are known, and what is left over."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.scene import Scene
from stickslip.simulation.result import Result

_POOR = 0.5
"""A standard error larger than this part of a value says that it is not determined."""


@dataclass(frozen=True)
class Measured:
    """One measured quantity over time.

    Attributes
    ----------
    name : str
        ``"BODY.velocity"``, ``"BODY.position"`` or ``"CONTACT.force"``.
    t, values : array (k,)
        Times in s and what was measured.
    sigma : array (k,) or None
        Standard deviations of the noise, where they are known.
    """

    name: str
    t: Array = field(repr=False)
    values: Array = field(repr=False)
    sigma: Array | None = field(repr=False)

    @property
    def of(self) -> str:
        """The name of the body or row."""
        return self.name.rpartition(".")[0]

    @property
    def quantity(self) -> str:
        """velocity, position or force."""
        return self.name.rpartition(".")[2]

    def read(self, result: Result) -> Array:
        """Return the quantity of a result at the measured times."""
        return np.asarray(getattr(result.sample(self.t), self.quantity)(self.of))


@dataclass(frozen=True)
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
    scene : Scene
        The scene with these values.
    result : Result
        Its motion.
    measured : tuple of Measured
    cost : float
        Half of the sum of the squares of the weighted residuals.
    starts : tuple of (array, float)
        Where each start of the search ended, and its cost there; best first.
    reasons : tuple of str
        Where derivatives do not exist at the solution.
    """

    parameters: tuple[str, ...]
    values: Array
    units: tuple[str, ...]
    covariance: Array = field(repr=False)
    scene: Scene = field(repr=False)
    result: Result = field(repr=False)
    measured: tuple[Measured, ...] = field(repr=False)
    cost: float
    starts: tuple[tuple[Array, float], ...] = field(repr=False)
    reasons: tuple[str, ...]

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
        """Size of the residuals over the standard deviations of the noise; 1 where none are given."""
        if any(one.sigma is None for one in self.measured):
            return 1.0
        return float(np.sqrt(2 * self.cost / self._freedom))

    @property
    def fits(self) -> bool:
        """Whether the residuals are no larger than noise makes them, to five standard deviations."""
        return bool(self.misfit**2 <= 1 + 5 * np.sqrt(2 / self._freedom))

    @property
    def _freedom(self) -> int:
        """Degrees of freedom: how many more values were measured than parameters fitted, at least 1."""
        return max(sum(one.t.size for one in self.measured) - self.values.size, 1)

    def residuals(self) -> dict[str, Array]:
        """Return what was measured less what the fitted scene does, by the names of the data."""
        return {one.name: one.values - one.read(self.result) for one in self.measured}

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
            lines.append(f"{name.ljust(width)}  {value:.8g} +- {error:.2g} {unit}{poor}".rstrip())
        correlation = np.abs(np.nan_to_num(self.correlation)) - np.eye(len(self.parameters))
        i, k = np.unravel_index(int(np.argmax(correlation)), correlation.shape)
        if correlation[i, k] > 0.9:
            lines.append(
                f"{self.parameters[i]} and {self.parameters[k]} are told apart poorly: "
                f"correlation {self.correlation[i, k]:.3f}"
            )
        if not self.fits:
            lines.append(
                f"the residuals are {self.misfit:.3g} times as large as the given sigma: the scene does not move as "
                "measured, and the standard errors mean nothing; look at the units, the first guess and the model"
            )
        return "\n".join([*lines, *self.reasons])
