"""What is known at an instant at which modes may change, and what is uncertain about it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Mask, Modes


class Inconsistent(Exception):
    """No set of modes satisfies the laws of all rows at rest."""

    def __init__(self, rows: Indices) -> None:
        super().__init__("no consistent modes")
        self.rows = rows


class Situation(NamedTuple):
    """What is known at an instant at which modes may change."""

    t: float  # time in s; loads have their right limits
    y: Array  # (size,)
    labels: Modes | None  # (m,): modes before, None at the start
    since: Array  # (m,): when each row last became held, in s
    touching: Mask  # (m,): rows whose relative velocity has been found to be 0
    fired: Mask  # (m,): rows found at their limit
    was: Array | None = None  # (size,): bounds of the sizes of the states while the modes before held
    # (p,): the regions of the piecewise-linear functions before, None at the start
    regions: Regions | None = None
    # (m,): +1 where a stop rests at its upper limit, -1 at its lower one, 0 elsewhere
    sides: Modes | None = None
    touched: int | None = None  # the row whose relative velocity only touches 0
    arrived: Mask | None = None  # (m,): open rows that come to rest by a drive, another row or a jump, None for none
    # (m,): rows that Karnopp's dead band does not stop, None for none
    moves_on: Mask | None = None

    @property
    def crossed(self) -> Mask:
        """Rows whose velocity has come to 0 for certain: it has passed 0, or arrived there."""
        found = self.fired & (self.labels != 0) if self.labels is not None else np.zeros_like(self.fired)
        return found if self.arrived is None else found | self.arrived

    def at_level(self, system: System) -> Mask:
        """Rows whose force has been found at its limit."""
        if self.labels is None:
            return self.fired
        found: Mask = self.fired & ((self.labels == 0) | system.is_stop)
        if self.touched is not None:
            # at a touch of 0 the row is held by its friction in motion, from which its level may begin to rise
            found[self.touched] = True
        return found


class Uncertainty(NamedTuple):
    """What the errors of a run leave uncertain."""

    velocity_resolution: Array  # (m,): relative velocities in m/s or rad/s that the tolerances do not resolve
    force_uncertainty: float  # part of the forces that is uncertain
    # (m,): how far relative velocities have to be beyond 0 for an event, in m/s or rad/s: what errors of steps add up
    # to; None where velocities are exact
    velocity_uncertainty: Array | None
