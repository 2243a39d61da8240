"""The forces of stuck contacts in many sets of modes at once.

Finding the rigid groups of one set costs far more than its forces. As parts of one large scene the groups of many
sets are found together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.grouping import Groups

__all__ = ["SideBySide"]

Array = NDArray[np.float64]


class SideBySide:
    """The rigid groups of many sets of modes, side by side as if they were one large scene.

    Parameters
    ----------
    system : System
    stuck : array (sets, m) of bool
        Which contacts are stuck.
    widths : sequence of int
        How many times belong to each set, one after the other.

    Attributes
    ----------
    holder : array (sets, n)
        The prescribed body that each body is stuck to, -1 for none.
    """

    def __init__(self, system: System, stuck: NDArray[np.bool_], widths: Sequence[int]) -> None:
        self._system, self._sets = system, len(widths)
        self._own, self._contact = stuck.nonzero()
        self._ends = system.a[self._contact], system.b[self._contact]
        n = system.n
        a, b = (np.where(end < n, self._own * n + end, (self._sets - 1) * n + end) for end in self._ends)
        self._groups = Groups(np.tile(system.inertia, self._sets), a, b)
        holder = self._groups.holder
        self.holder = np.where(holder < 0, -1, holder - (self._sets - 1) * n).reshape(self._sets, n)
        self._set = np.repeat(np.arange(self._sets), widths)
        self._column = np.concatenate([np.arange(width) for width in widths])
        self._width = max(widths)

    def _apart(self, values: Array) -> Array:
        """Return rows of values (times as columns) with an axis for the sets in front, 0 where one has fewer times."""
        apart = np.zeros((self._sets, values.shape[0], self._width))
        apart[self._set, :, self._column] = values.T
        return apart

    def forces(self, pushed: Array, accelerations: Array) -> Array:
        """Return the forces of stuck contacts (rows: all) from the forces on bodies and the drives' accelerations."""
        system, n = self._system, self._system.n
        of_drives = self._apart(accelerations)
        held = np.zeros((self._sets, n, self._width))
        driven = (self.holder >= n) & (self.holder < n + system.drives)
        held[driven] = of_drives[driven.nonzero()[0], self.holder[driven] - n]
        parting = None
        if self._groups.redundant and system.drives:
            ground = np.zeros((self._sets, 1, self._width))
            ends = np.concatenate([held, of_drives, ground], axis=1)
            parting = ends[self._own, self._ends[0]] - ends[self._own, self._ends[1]]
        flat = (self._sets * n, self._width)
        found = np.zeros((self._sets, system.m, self._width))
        found[self._own, self._contact] = self._groups.contact_forces(
            self._apart(pushed).reshape(flat), held.reshape(flat), parting
        )
        return found[self._set, :, self._column].T
