"""The tolerances that a solver is asked for."""

from __future__ import annotations

import numpy as np

from stickslip.engines.base import LOCAL, Task
from stickslip.equations.algebra.matrices import row_maxima
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array

# If a spring makes more than so many tolerances of a velocity out of the tolerance of a position, that of positions
# becomes smaller, until these are so many.
_TOO_FAR, _NEAR = 1e3, 30.0

_SLOW = 1e-2  # a body is led if its velocity changes by less than this part of itself while its spring could swing once
_FINEST = 1e-14  # least relative tolerance
_ROUNDOFF = 1e-14  # part of the terms of a velocity that is uncertain
_STEP = 1e-2  # part of the time in which a drive changes: rough accelerations should not ask for shorter steps


def noise_of_led(motion: Motion, horizon: float) -> tuple[Array, Array]:
    """Return the noise (n,) that a step leaves in positions and velocities of bodies which drives lead.

    Where a drive is led by a function, its velocity has the roundoff of the function, and its acceleration is a
    difference. Where none is, there is no noise.
    """
    system, segment, none = motion.system, motion.segment, np.zeros(motion.system.n)
    if not (motion.equations.is_driven and system.lead_drives(segment.by_functions)):
        return none, none
    try:
        accelerations, rough = system.accelerations_of_drives(segment)
    except (ArithmeticError, ValueError):
        # a load that fails at a later time fails again when the solver comes to it
        return none, none
    velocity = row_maxima(system.drive_velocities(segment.patterns.T))
    acceleration = row_maxima(accelerations)
    step = _STEP * np.minimum(horizon, velocity / np.where(acceleration > 0, acceleration, np.inf))
    led = abs(motion.equations.balance.U)
    return led @ (step * system.drive_velocities(segment.roughness)), led @ (step * rough)


class SolverTolerances:
    """The tolerances that a solver is asked for.

    SUNDIALS knows one relative tolerance for all states. Far from 0, that of a position is more than the velocity of a
    body that a stiff spring leads slowly can bear: what a solver leaves over in positions then is noise in velocities,
    its steps fail, and no shorter step helps. Where that is seen, the relative tolerance becomes smaller, and absolute
    ones no less than roundoff. A method that is not `for_stiff` motions takes short steps, without such noise.

    Attributes
    ----------
    asked, now : (float, array (size,))
        Relative tolerance, and the absolute ones of the states: at first, and now.
    changes : int
        How often they have changed.
    """

    def __init__(self, task: Task, for_stiff: bool = True) -> None:
        self.asked, self._speeds, self._for_stiff = (LOCAL * task.rtol, LOCAL * task.atol), task.speeds, for_stiff
        self.now, self.changes = self.asked, 0

    def adapt(self, motion: Motion, tau: float, y: Array) -> bool:
        """Adapt the tolerances to the state `y`; tell whether they have changed."""
        if not self._for_stiff:
            return False
        (asked, least), (rtol, atol) = self.asked, self.now
        system = motion.system
        n, positions = system.n, slice(system.n, system.first_bristle)
        jacobian = abs(motion.jacobian(tau, y)[:n])
        stiffness, damping = jacobian[:, positions], row_maxima(jacobian[:, :n])
        frequency = np.sqrt(row_maxima(stiffness))
        # an error of a position, as the velocity with which its spring ends it: damping makes that slower
        speed = (stiffness @ np.abs(y[positions])) / np.where(frequency > 0, np.maximum(frequency, damping), 1.0)
        sizes = np.abs(y[:n])
        # a body that its spring lets oscillate needs short steps for that
        led = np.abs(motion.rate(tau, y)[:n]) < _SLOW * frequency * np.maximum(sizes, self._speeds)
        roundoff = np.where(led, _ROUNDOFF * speed, 0.0)
        times = float((rtol * speed / np.maximum(least[:n], asked * sizes)).max(initial=0.0, where=led))
        is_too_far = times > _TOO_FAR and rtol > _FINEST
        # as positions grow, so does their roundoff
        is_too_fine = self.changes > 0 and bool((roundoff > atol[:n]).any())
        if not (is_too_far or is_too_fine):
            return False
        atol = least.copy()
        atol[:n] = np.maximum(least[:n], 2 * roundoff)
        self.now = max(rtol * _NEAR / times, _FINEST) if is_too_far else rtol, atol
        self.changes += 1
        return True
