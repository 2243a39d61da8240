"""Bristles along a run: whether they relax faster than they can be followed."""

from __future__ import annotations

import numpy as np

from stickslip.engines.work import SolverFailure
from stickslip.equations.mode_equations import OPEN
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.model.arrays import Array
from stickslip.model.laws.lugre import FASTEST

_TOO_MUCH = 1e-4  # part of the impulse of their level by which that of bristles may be larger


class Relaxation:
    """Adds up how much more friction bristles have had than their level, because they relax no faster than `FASTEST`.

    Normal forces that depend on the state are left out.
    """

    def __init__(self, system: System) -> None:
        rows = [j for j in system.bristle_state if not system.pressed[j] and system.mu_s[:, j].max() > 0]
        self._system, self.rows = system, np.array(rows, dtype=np.intp)
        stiffness = [system.laws.characters[j].stiffness or 0.0 for j in rows]
        self._least, self._mu = np.array(stiffness) / FASTEST, system.mu_s[:, rows].max(axis=0, initial=0.0)
        self._beyond, self._level = np.zeros(len(rows)), np.zeros(len(rows))

    def note(self, motion: Motion, path: Path) -> None:
        """Add a path; where a contact has had too much friction, that is a `SolverFailure`."""
        taus, loads = path.taus, motion.loads(path.taus)
        w = self._system.relative_velocity(path.points.T, loads)[self.rows]
        closed = (motion.equations.modes[self.rows] != OPEN)[:, None]
        level = self._mu[:, None] * np.maximum(loads[self.rows], 0.0)
        beyond = np.maximum(self._least[:, None] * np.abs(w) - level, 0.0)
        self._beyond += _over(taus, beyond * closed)
        self._level += _over(taus, level)
        for k in (self._beyond > _TOO_MUCH * self._level).nonzero()[0].tolist():
            name = self._system.rows[int(self.rows[k])].name
            raise SolverFailure(
                f"contact {name!r}: its bristles relax faster than {FASTEST:g} /s and cannot be followed: their "
                "friction is larger than its level",
                "make the stiffness smaller, or use DryFriction there",
                path,
            )


def _over(taus: Array, values: Array) -> Array:
    """Return the integrals of some values over time."""
    return np.asarray(0.5 * (values[:, 1:] + values[:, :-1]) @ np.diff(taus))
