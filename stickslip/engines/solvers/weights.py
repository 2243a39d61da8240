"""The tolerances that a solver tests its errors with."""

from __future__ import annotations

import numpy as np

from stickslip.engines.base import LOCAL, Task
from stickslip.equations.algebra.matrices import row_maxima
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array

# So many times the tolerance of a velocity may a spring make of the tolerance of positions.
_TOO_FAR = 1e3

_SLOW = 1e-2  # a body is led if its velocity changes by less than this part of itself while its spring could swing once
_FINEST = 1e-14  # least relative tolerance
_ROUNDOFF = 1e-14  # part of the terms of a velocity that is uncertain


class Weights:
    """The tolerances that a solver tests its errors with: `rtol` of all states, and `atol` (size,).

    SUNDIALS knows one relative tolerance for all states. Far from 0, that of a position is more than the velocity of a
    body that a stiff spring leads slowly can bear: what a solver leaves over in positions then is noise in velocities,
    its steps fail, and no shorter step helps. Where that is seen, `rtol` becomes smaller for the rest of a run, and
    `atol` no less than roundoff. With a method that is not `for_stiff` motions the steps are short anyway.
    """

    def __init__(self, task: Task, for_stiff: bool = True) -> None:
        self._for_stiff = for_stiff
        self.rtol, self.atol = LOCAL * task.rtol, LOCAL * task.atol
        self._of_velocities = self.rtol * task.speeds

    @property
    def tolerance(self) -> tuple[float, Array]:
        """Both, relative and absolute."""
        return self.rtol, self.atol

    def adapt(self, motion: Motion, tau: float, y: Array) -> bool:
        """Adapt the tolerances if positions in the state `y` are too far from 0 for them; tell whether they are."""
        if not self._for_stiff:
            return False
        system = motion.system
        n, positions = system.n, slice(system.n, system.first_bristle)
        distances = np.abs(y[positions])
        stiffness = abs(motion.jacobian(tau, y)[:n, positions])
        frequency = np.sqrt(row_maxima(stiffness))
        # an error of a position, as a velocity with which its spring would end it
        speed = (stiffness @ distances) / np.where(frequency > 0, frequency, 1.0)
        wanted = np.maximum(self.atol[:n], self._of_velocities)
        allowed = np.maximum(wanted, self.rtol * np.abs(y[:n]))
        # a body that its spring lets oscillate needs short steps for that
        led = np.abs(motion.rate(tau, y)[:n]) * self.rtol < _SLOW * frequency * allowed
        times = float((self.rtol * speed / allowed).max(initial=0.0, where=led))
        roundoff = np.where(led, _ROUNDOFF * speed, 0.0)
        too_far, too_fine = times > _TOO_FAR and self.rtol > _FINEST, bool((roundoff > self.atol[:n]).any())
        if too_far:
            self.rtol = max(self.rtol / times, _FINEST)
        if too_far or too_fine:
            # as positions grow, so does their roundoff
            self.atol[:n] = np.maximum(wanted, 2 * roundoff)
        return too_far or too_fine
