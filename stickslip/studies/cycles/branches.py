"""Branches of limit cycles over a parameter: where they gain or lose stability, change their phases, and end."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.model.arrays import Array, Mask
from stickslip.studies.cycles.cycle import Cycle
from stickslip.studies.parameters import named_parameters


@dataclass(frozen=True)
class BranchPoint:
    """A value of the parameter at which cycles change their kind.

    Attributes
    ----------
    value : float
        Of the parameter.
    kind : str
        "fold" (two cycles meet, and the branch turns back), "crossing" (a multiplier passes 1, and the branch goes on:
        a symmetry breaks, or another branch crosses), "flip" (a multiplier passes -1), "torus" (a pair of them passes
        the unit circle), "sequence" (other changes of modes) or "end" (no cycle near by).
    message : str
        What happens, in words.
    cycle : Cycle or None
        The cycle there, or next to it; None at an end where none was reached.
    """

    value: float
    kind: str
    message: str
    cycle: Cycle | None = field(default=None, repr=False, compare=False)

    def __str__(self) -> str:
        return f"{self.value:.9g}  {self.kind}: {self.message}"


@dataclass(frozen=True, eq=False)
class Branch:
    """Limit cycles over a parameter.

    Attributes
    ----------
    parameter : str
    values : array (n,)
        Of the parameter.
    cycles : tuple of Cycle or None
        One for each value, None beyond the end of the branch.
    points : tuple of BranchPoint
        Where the kind of the cycles changes.
    beyond : Branch or None
        The branch beyond a fold, back over the values; None where there is no fold.
    """

    parameter: str
    values: Array
    cycles: tuple[Cycle | None, ...] = field(repr=False)
    points: tuple[BranchPoint, ...]
    beyond: Branch | None = field(default=None, repr=False)

    @cached_property
    def periods(self) -> Array:
        """Periods in s, NaN where there is no cycle."""
        return np.array([np.nan if one is None else one.period for one in self.cycles])

    @cached_property
    def multipliers(self) -> NDArray[np.complex128]:
        """Multipliers, a line for each value; NaN where there is none."""
        count = max((one.multipliers.size for one in self.cycles if one is not None), default=0)
        found = np.full((len(self.cycles), count), np.nan, dtype=complex)
        for k, one in enumerate(self.cycles):
            if one is not None:
                found[k, : one.multipliers.size] = one.multipliers
        return found

    @cached_property
    def stable(self) -> Mask:
        """Whether each cycle is stable."""
        return np.array([one is not None and one.stable for one in self.cycles])

    @property
    def unit(self) -> str:
        """The SI unit of the parameter, empty where it has none or no cycle was found."""
        scenes = (one.scene for one in self.cycles if one is not None)
        return next((named_parameters(s, [self.parameter], "Branch")[0].unit(s) for s in scenes), "")

    def amplitudes(self, body: str) -> Array:
        """Return half of the ranges of a body's position in m or rad, NaN where there is no cycle.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        return np.array([np.nan if one is None else one.amplitude(body) for one in self.cycles])

    def plot(self, body: str | None = None, *, ax: Any = None) -> Any:
        """Draw the bifurcation diagram: the amplitude of a body, or the period, over the parameter.

        Parameters
        ----------
        body : str, optional
            By default the period is drawn.
        ax : matplotlib axes, optional
            By default a new figure.
        """
        from stickslip import plots

        return plots.bifurcation(self, body, ax=ax)

    def __str__(self) -> str:
        """Return a table, and the points where the kind of the cycles changes."""
        lines = [f"{self.parameter:>16}  {'period':>14}  largest multiplier"]
        for value, one in zip(self.values, self.cycles, strict=True):
            if one is None:
                lines.append(f"{value:16.9g}  {'-':>14}")
                continue
            largest = float(np.abs(one.multipliers).max(initial=0.0))
            kind = "" if one.stable else " neutral" if one.neutral else " unstable"
            lines.append(f"{value:16.9g}  {one.period:14.9g}  {largest:.6g}{kind}")
        lines += map(str, self.points)
        return "\n".join(lines if self.beyond is None else [*lines, "beyond the fold", str(self.beyond)])
