"""Directions in which the start of a scene or the scene itself changes, as scenes near by and their weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.equations.loads import Loads
from stickslip.equations.system import System
from stickslip.model.arrays import Array
from stickslip.model.scene import Scene
from stickslip.results.trajectory import Trajectory
from stickslip.studies.parameters import Parameter

PART = 1e-3
"""Step of a difference as a part of what changes."""

_FINE_PART = 1e-5
"""The same where forces bend at rest: near by, a contact that has just begun to slip may slip the other way."""

CENTRAL = ((-1.0, -8 / 12), (1.0, 8 / 12), (-2.0, 1 / 12), (2.0, -1 / 12))
_ONE_SIDED = ((0.0, -25 / 12), (1.0, 4.0), (2.0, -3.0), (3.0, 4 / 3), (4.0, -0.25))
MIRRORED = tuple((-offset, -weight) for offset, weight in _ONE_SIDED)
"""Offsets and weights of derivatives of fourth order, so ordered that what is constant adds up to 0 exactly."""


@dataclass(frozen=True)
class Direction:
    """A direction in which the start or the scene changes."""

    name: str
    # systems near by and the weights with which a quantity of theirs adds up to its derivative; empty where
    # only the start changes
    near: tuple[tuple[float, System, Loads], ...]
    y: Array  # (size,): how the state changes at the start, before held velocities are made equal
    since: Array  # (m,): how the times change at which rows became held
    size: float = 1.0  # of what changes: derivatives times it have the size of what they are derivatives of


def along_parameter(scene: Scene, parameter: Parameter, trajectory: Trajectory, what: str) -> Direction:
    """Return the direction in which one parameter grows.

    If the scene exists at no values near by, or has another structure there, that is a ValueError.
    """
    nominal = trajectory.system
    bends = any(one.velocity_dependent for one in nominal.laws.characters)
    h = (_FINE_PART if bends else PART) * (abs(parameter.value) or 1.0)
    refused: Exception | None = None
    differs = False
    near: list[tuple[float, System, Loads]] = []
    for stencil in (CENTRAL, _ONE_SIDED, MIRRORED):
        near = []
        try:
            for offset, weight in stencil:
                system = System(parameter.set(scene, parameter.value + offset * h))
                differs |= not _alike(nominal, system)
                near.append((weight / h, system, system.loads(*trajectory.span)))
        except (ValueError, TypeError) as error:
            refused, near = refused or error, []
        if near:
            break
    if differs:
        raise ValueError(
            f"{what}: parameter {parameter.name!r}: near its value the scene has other states or contacts (a "
            "stiffness, dwell time or coefficient that is 0, or a dwell time between equal coefficients); give it "
            "another value"
        )
    if not near:
        raise ValueError(
            f"{what}: parameter {parameter.name!r} has no values near {parameter.value:g}: {refused}"
        )
    y = sum((weight * system.at_start() for weight, system, _ in near), np.zeros(nominal.size))
    rested = [(weight, np.array([row.rested for row in system.rows])) for weight, system, _ in near]
    since = sum((weight * (trajectory.span.start - times) for weight, times in rested), np.zeros(nominal.m))
    near_ones = () if parameter.only_at_start else tuple(near)
    return Direction(parameter.name, near_ones, y, since, abs(parameter.value) or 1.0)


def _alike(nominal: System, other: System) -> bool:
    """Tell whether two scenes have the same states, and contacts that dwell and carry forces."""
    return (
        nominal.size == other.size
        and nominal.inputs == other.inputs
        and np.array_equal(nominal.dwelling, other.dwelling)
        and np.array_equal(nominal.alive, other.alive)
        and np.array_equal(nominal.placed, other.placed)
        and np.array_equal(nominal.piecewise.within, other.piecewise.within)
        and np.array_equal(nominal.piecewise.beyond, other.piecewise.beyond)
    )
