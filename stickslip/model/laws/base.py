"""What the core asks of a friction law: a few facts, and the forces of many contacts at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.quantities import as_expression
from stickslip.model.signals import Load, Signal


@dataclass(frozen=True)
class Character:
    """How a law behaves near rest, and what it asks of a solver.

    A law either sticks exactly, or has a slip state, or has no modes at all.
    """

    sticks: bool = False  # at rest its force is whatever keeps it there, within ``mu_st N`` on both sides
    # a binary slip state: where it is false, the kernel gives the force; where it is true, the force is ``mu_k N``
    has_slip_state: bool = False
    # relative velocity in m/s or rad/s from which it slips; without modes, from which it is shown as slipping
    slips_beyond: float = 0.0
    # relative velocity in m/s or rad/s below which a slipping contact sticks, or its slip state becomes false
    rests_below: float = 0.0
    # range of relative velocity in m/s or rad/s in which its force changes sign: the tolerances resolve it
    resolution: float = math.inf
    # force in N or N m per unit of a state of its own, a bristle; None where it has none
    stiffness: float | None = None
    # what makes its force depend on velocity, in words; then the motion has no Taylor series. Empty where nothing does
    velocity_dependent: str = ""


@dataclass(frozen=True)
class Use:
    """A contact in which a law is used, from `start` to `stop` in s."""

    label: str
    ends: tuple[str, str]
    both_move: bool
    """Whether both ends are bodies, not the ground or a drive."""
    load: Load
    """The normal force in N as it was given."""
    start: float
    stop: float

    @property
    def normal(self) -> Signal | None:
        """The normal force in N; None where it depends on the motion, and is not known before the run."""
        pressed = as_expression(self.load)
        return None if pressed.terms else pressed.signal


class Kernel:
    """Forces of some contacts of one law that depend on their velocities.

    The methods take relative velocities `w`, normal forces, `lag`, which is the part ``exp(-(t - t_start)/tau)`` of
    ``mu_s - mu_c`` by which the static coefficient has not risen yet, and the contacts' own states `z`: arrays (k,).
    Those that do not return derivatives also take arrays (k, times).
    """

    has_state: ClassVar[bool] = False

    def __init__(self, laws: Sequence[Any]) -> None:
        """Take the numbers of the laws, one per contact."""
        raise NotImplementedError

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the forces."""
        raise NotImplementedError

    def in_floats(self, place: int) -> Callable[..., Any] | None:
        """Return a function of two floats, `w` and normal force, that returns the force of one contact.

        The normal force may be negative. If the contact has a state of its own, this is a third argument, and the
        function returns the force and the rate of the state. None if there is no such function, or if the force
        depends on `lag`.
        """
        return None

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the derivatives of the forces with respect to `w`, at fixed states `z`."""
        raise NotImplementedError

    def slope_cut(self, w: Array, normal: Array) -> Array:
        """Return the true derivatives minus `slopes`, where those are flatter than the true ones to help a solver."""
        return np.zeros_like(w)

    def rates(self, w: Array, normal: Array, z: Array) -> Array:
        """Return ``z'``."""
        raise NotImplementedError

    def rate_slopes(self, w: Array, normal: Array, z: Array) -> tuple[Array, Array]:
        """Return the derivatives of ``z'`` with respect to `w` and `z`."""
        raise NotImplementedError

    def relaxation(self, w: Array, normal: Array) -> Array:
        """Return the rates at which the contacts' own states relax."""
        raise NotImplementedError

    def by_normal(self, w: Array, normal: Array, lag: Array, z: Array) -> tuple[Array, Array]:
        """Return the derivatives of forces and rates with respect to normal forces; here forces are proportional."""
        force = self.forces(w, normal, lag, z)
        return np.divide(force, normal, out=np.zeros_like(force), where=normal > 0), np.zeros_like(z)

    def by_state(self, w: Array, normal: Array, z: Array) -> Array:
        """Return the derivatives of the forces with respect to `z`."""
        raise NotImplementedError
