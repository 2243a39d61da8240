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
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices


class Knot:
    """The equations of one knot in one set of modes.

    `matrices` are the coefficients of its held rows on its bodies and on all drives, and the map from the forces on its
    bodies to those that rows at their level would carry, the shares of `ModeEquations`.

    Attributes
    ----------
    bodies, held, at_level : array of int
        Its bodies, its held rows, and those that carry their level.
    dependent : int
        How many velocities of its bodies follow from others.
    rests : bool
        Whether any row is held: else each body moves by itself.
    mobility : array (k, k)
        Accelerations from the forces on the bodies.
    led : array (k, d)
        Accelerations from the accelerations of the drives.
    """

    def __init__(
        self, system: System, bodies: Indices, held: Indices, at_level: Indices, matrices: tuple[Array, Array, Array]
    ) -> None:
        self.bodies, self.held, self.at_level = bodies, held, at_level
        G, D, self._shares = matrices
        self._balance = balance = Balance(system.inertia[bodies], G, D, independent=system.independent)
        self.dependent = balance.dependent.size
        self.rests = held.size + at_level.size > 0
        nothing = np.zeros((bodies.size, system.drives))
        self.mobility = balance.accelerations(np.eye(bodies.size))
        self.led = balance.accelerations(nothing, np.eye(system.drives))

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
                latest = self._latest[k] = modes, _knot_in(equations, bodies, rows)
            found.append(latest[1])
        return found


def _knot_in(equations: ModeEquations, bodies: Indices, rows: Indices) -> Knot:
    """Return the equations of one knot from those of the whole scene."""
    held, at_level = np.intersect1d(rows, equations.held), np.intersect1d(rows, equations.at_level)
    shares = np.empty((0, bodies.size))
    if equations.shares is not None:
        shares = dense(equations.shares[equations.at_level.searchsorted(at_level)])[:, bodies]
    system = equations.system
    G, D = dense(system.G[held])[:, bodies], dense(system.D[held])
    return Knot(system, bodies, held, at_level, (G, D, shares))
