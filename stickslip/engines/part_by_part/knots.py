"""Knots of a scene that is followed part by part: bodies that rows join in other ways than by trees of contacts.

Their modes stay as long as the scene is followed part by part: between events the accelerations in a knot are linear in
the forces on its bodies.
"""

from __future__ import annotations

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.balance import Balance
from stickslip.equations.forest import Forest
from stickslip.equations.mode_equations import ModeEquations
from stickslip.model.arrays import Array, Indices


class Knot:
    """The equations of one knot in the modes in which a motion begins.

    Attributes
    ----------
    bodies, held, at_level : array of int
        Its bodies, its held rows, and those that carry their level.
    mobility : array (k, k)
        Accelerations from the forces on the bodies.
    led : array (k, d)
        Accelerations from the accelerations of the drives.
    """

    def __init__(self, equations: ModeEquations, bodies: Indices, rows: Indices) -> None:
        system = equations.system
        self.bodies = bodies
        self.held, self.at_level = np.intersect1d(rows, equations.held), np.intersect1d(rows, equations.at_level)
        G, D = dense(system.G[self.held])[:, bodies], dense(system.D[self.held])
        self._balance = balance = Balance(system.inertia[bodies], G, D, independent=system.independent)
        nothing = np.zeros((bodies.size, system.drives))
        self.mobility = balance.accelerations(np.eye(bodies.size))
        self.led = balance.accelerations(nothing, np.eye(system.drives))
        self._shares = np.empty((0, bodies.size))
        if equations.shares is not None:
            places = equations.at_level.searchsorted(self.at_level)
            self._shares = dense(equations.shares[places])[:, bodies]

    def consistent(self, v: Array, u: Array) -> Array:
        """Return velocities, values or series, that satisfy the held rows to the last bit."""
        return self._balance.consistent(v, u)

    def forces(self, rest: Array) -> Array:
        """Return the forces of held rows, then those that rows at their level would carry.

        `rest` are all other forces less inertia times acceleration.
        """
        held = self._balance.held_forces(rest, np.zeros(rest.shape))
        return np.concatenate([held, self._shares @ rest])


class Knots:
    """The knots of a scene; each is kept until its modes change, for an event changes few."""

    def __init__(self, forest: Forest) -> None:
        self._bodies = forest.knots
        self._rows = [(forest.knot_of_row == k).nonzero()[0] for k in range(len(forest.knots))]
        self._latest: dict[int, tuple[bytes, Knot]] = {}

    def at(self, equations: ModeEquations) -> list[Knot]:
        """Return all in the modes of a motion."""
        found = []
        for k, (bodies, rows) in enumerate(zip(self._bodies, self._rows, strict=True)):
            modes = equations.modes[rows].tobytes()
            latest = self._latest.get(k)
            if latest is None or latest[0] != modes:
                latest = self._latest[k] = modes, Knot(equations, bodies, rows)
            found.append(latest[1])
        return found
