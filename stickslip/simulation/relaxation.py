"""Bristles along a run: whether they can be followed."""

from __future__ import annotations

import numpy as np

from stickslip.engines.work import SolverFailure
from stickslip.equations.mode_equations import OPEN
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.model.arrays import Array
from stickslip.model.laws.lugre import MAX_RATE, NEARLY_OPEN

_RESTS = 1e-8  # part of the fastest velocity of a contact below which it is at rest
# A normal force counts as rising from 0 if it is smaller than this part of its rise in the time ahead.
_FROM_NOTHING = 1e-6

_TOO_MUCH = 1e-4  # part of the impulse of its level by which a bristle's impulse may exceed it


class Relaxation:
    """Adds up how much more friction bristles have had than their level, because they relax no faster than `MAX_RATE`.

    It also refuses normal forces that depend on the state and come back from nearly 0 while the contact slides: its
    bristles then become softer by powers of ten within a step, and solvers keep the stiffness before.
    """

    def __init__(self, system: System) -> None:
        rows = [j for j in system.bristle_state if system.mu_s[:, j].max() > 0]
        self._system, self.rows = system, np.array(rows, dtype=np.intp)
        self._pressed = system.pressed[self.rows]
        self._pressing, self._fastest = np.zeros(len(rows)), np.zeros(len(rows))
        stiffness = [system.laws.characters[j].stiffness or 0.0 for j in rows]
        self._least, self._mu = np.array(stiffness) / MAX_RATE, system.mu_s[:, rows].max(axis=0, initial=0.0)
        self._beyond, self._level = np.zeros(len(rows)), np.zeros(len(rows))
        self._following = [j for j in system.bristle_state if system.pressed[j]]

    def check(self, last: Motion | None, motion: Motion, resolution: Array) -> None:
        """Refuse a bristle whose normal force rises from 0: solvers follow so stiff a motion wrongly, without an error.

        `last` is the motion before. A contact slides if it starts faster than the `resolution` of velocities.
        """
        for j in self._following:
            was = OPEN if last is None else last.equations.modes[j]
            if was != OPEN or motion.equations.modes[j] == OPEN:
                continue
            normal, rise = (float(one[j]) for one in motion.start.q[:2])
            slides = abs(float(motion.start.z[0, j])) > resolution[j]
            if slides and normal < _FROM_NOTHING * rise * motion.horizon:
                raise ArithmeticError(
                    f"contact {self._system.rows[j].name!r}: its normal force rises from 0, where a bristle is "
                    "infinitely stiff; let it stay above 0, or use DryFriction"
                )

    def note(self, motion: Motion, path: Path) -> None:
        """Add a path; raise a `SolverFailure` where a contact has had too much friction."""
        taus, states, loads = path.taus, path.points.T, motion.loads(path.taus)
        w = self._system.relative_velocity(states, loads)[self.rows]
        closed = (motion.equations.modes[self.rows] != OPEN)[:, None]
        normals = (motion.normals(taus, states) if self._pressed.any() else np.maximum(loads, 0.0))[self.rows]
        self._note_returns(motion, path, np.abs(w), normals * closed)
        level = self._mu[:, None] * normals
        beyond = np.maximum(self._least[:, None] * np.abs(w) - level, 0.0)
        self._beyond += _over(taus, beyond * closed)
        self._level += _over(taus, level)
        for k in (self._beyond > _TOO_MUCH * self._level).nonzero()[0].tolist():
            name = self._system.rows[int(self.rows[k])].name
            raise SolverFailure(
                f"contact {name!r}: its bristles relax faster than {MAX_RATE:g} /s and cannot be followed: their "
                "friction is larger than its level",
                "make the stiffness smaller, or use DryFriction there",
                path,
            )

    def _note_returns(self, motion: Motion, path: Path, speed: Array, normals: Array) -> None:
        """Refuse normal forces that depend on the state and come back from nearly 0 while the contact slides.

        The faster a contact slides, the larger are forces that count as nearly 0.
        """
        self._pressing = np.maximum(self._pressing, normals.max(axis=1))
        self._fastest = np.maximum(self._fastest, speed.max(axis=1))
        near = NEARLY_OPEN * self._pressing[:, None] * speed
        returns = (normals * self._fastest[:, None] < near)[:, :-1] & (np.diff(normals) > 0)
        returns &= self._pressed[:, None] & (speed > _RESTS * self._fastest[:, None])[:, :-1]
        if not returns.any():
            return
        place, k = (int(one[0]) for one in returns.T.nonzero())
        raise SolverFailure(
            f"contact {self._system.rows[int(self.rows[k])].name!r}: its normal force comes back from nearly 0 while "
            "it slides, where a bristle is all but infinitely stiff",
            f"let it stay above {NEARLY_OPEN * self._pressing[k]:.3g}, or use DryFriction",
            motion.until(path, float(path.taus[place])) if place else Path.of_start(motion.y),
        )


def _over(taus: Array, values: Array) -> Array:
    """Return the integrals of some values over time, by the trapezoidal rule."""
    return np.asarray(0.5 * (values[:, 1:] + values[:, :-1]) @ np.diff(taus))
