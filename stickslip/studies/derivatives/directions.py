"""Directions in which the start of a scene or the scene itself changes, as scenes near by and their weights."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from stickslip.equations.loads.loads import Loads
from stickslip.equations.system import System
from stickslip.model.arrays import Array
from stickslip.model.scene import Scene
from stickslip.results.trajectory import Trajectory
from stickslip.studies.parameters import Parameter

PART = 1e-3  # step of a finite difference, as a part of the size of the number that is changed

# Largest angle in rad by which a sine may turn over the whole run if its frequency changes by its size.
_TURN = 5.0

# Numbers in what functions and blocks read are no forces, but in the units of what is read.
_ARGUMENTS = frozenset(("arguments", "quantity", "inputs"))

_LEAST = 1e-2  # least size of a number, as a part of the size of the quantity that it is added to

# Takes the place of PART where forces depend on velocity. They bend at rest: near by, a contact that has just begun to
# slip may slip the other way.
_PART_WITH_BENDS = 1e-5

# The same where forces are functions of the state: these may bend within any small part of large arguments.
_PART_WITH_FUNCTIONS = 1e-6

CENTRAL = ((-1.0, -8 / 12), (1.0, 8 / 12), (-2.0, 1 / 12), (2.0, -1 / 12))
_ONE_SIDED = ((0.0, -25 / 12), (1.0, 4.0), (2.0, -3.0), (3.0, 4 / 3), (4.0, -0.25))

# Offsets and weights of differences of fourth order. In this order the weights of CENTRAL add up to exactly 0, so a
# constant contributes nothing; those of the others add up to 0 within roundoff.
MIRRORED = tuple((-offset, -weight) for offset, weight in _ONE_SIDED)

_STENCILS = CENTRAL, _ONE_SIDED, MIRRORED


@dataclass(frozen=True)
class Direction:
    """A direction in which the start or the scene changes."""

    name: str
    # weights, systems near by and their loads: the weighted sum of a quantity over these systems is its
    # derivative; empty where only the start changes
    near: tuple[tuple[float, System, Loads], ...]
    y: Array  # (size,): how the state changes at the start, before held velocities are made equal
    since: Array  # (m,): how the times change at which rows became held
    size: float = 1.0  # of the number that changes: a derivative times it is about as large as the quantity itself
    # (n + drives,): how the positions of bodies and drives change at the start; empty where only states change
    positions: Array = field(default_factory=lambda: np.zeros(0))
    # whether to one side the scene has other states or contacts: the derivatives to both sides may differ
    changes_to_one_side: bool = False


def along_parameter(scene: Scene, parameter: Parameter, trajectory: Trajectory, what: str) -> Direction:
    """Return the direction in which one parameter grows.

    If the scene exists at no values near by, or has another structure there, that is a ValueError.
    """
    nominal = trajectory.system
    part, natural = _part(nominal), _size(scene, parameter, trajectory)
    sizes = dict.fromkeys([natural, abs(parameter.value) or natural])
    refused: Exception | None = None
    differs = False
    near: list[tuple[float, System, Loads]] = []
    # A step by the natural size may be refused beside the other numbers of the scene, as a limit of a stop beyond the
    # other limit. Then the size of the value itself is tried.
    for size, stencil in product(sizes, _STENCILS):
        h = part * size
        try:
            systems = [
                System(parameter.set(scene, parameter.value + offset * h), generic=nominal.generic)
                for offset, _ in stencil
            ]
            loads = [system.loads(*trajectory.span) for system in systems]
        except (ValueError, TypeError) as error:
            refused = refused or error
            continue
        if all(_alike(nominal, system) for system in systems):
            weights = [weight / h for _, weight in stencil]
            near = list(zip(weights, systems, loads, strict=True))
            break
        differs = True
    if differs and not near:
        raise ValueError(
            f"{what}: parameter {parameter.name!r}: near its value the scene has other states or contacts (a "
            "stiffness, dwell time or coefficient that is 0, or a dwell time between equal coefficients); give it "
            "another value"
        )
    if not near:
        raise ValueError(f"{what}: parameter {parameter.name!r} has no values near {parameter.value:g}: {refused}")
    y = sum((weight * system.at_start() for weight, system, _ in near), np.zeros(nominal.size))
    rested = [(weight, np.array([row.rested for row in system.rows])) for weight, system, _ in near]
    since = sum((weight * (trajectory.span.start - times) for weight, times in rested), np.zeros(nominal.m))
    placed = [(weight, [*system.scene.bodies, *system.scene.drives]) for weight, system, _ in near]
    positions = np.zeros(nominal.n + nominal.drives)
    for weight, moving in placed:
        positions += weight * np.array([one.position for one in moving])
    near_ones = () if parameter.only_at_start else tuple(near)
    return Direction(parameter.name, near_ones, y, since, size, positions, changes_to_one_side=differs)


def _part(system: System) -> float:
    """Return the step of a finite difference as a part of the size of a parameter."""
    if system.dependence is not None and not system.dependence.is_linear:
        return _PART_WITH_FUNCTIONS
    return _PART_WITH_BENDS if any(one.velocity_dependent for one in system.laws.characters) else PART


def _size(scene: Scene, parameter: Parameter, trajectory: Trajectory) -> float:
    """Return the size of a parameter: over a small part of it, the motion depends on the parameter almost linearly."""
    field, size = parameter.field, abs(parameter.value)
    if field == "phase":
        return 1.0
    if field == "frequency":
        latest = max(map(abs, trajectory.span[:2]))
        return min(size or math.inf, _TURN / (2 * math.pi * latest))
    if field == "times":
        # small beside the distance to the next breaks: the order of the breaks must not change
        return min((one for one in parameter.distances_to_neighbours(scene) if one > 0), default=size or 1.0)
    if _ARGUMENTS.isdisjoint(parameter.steps):
        size = max(size, _LEAST * _size_added_to(field, trajectory))
    return size or 1.0


def _size_added_to(field: str, trajectory: Trajectory) -> float:
    """Return the size of the quantity that a number is added to: a length, a velocity, a force, or a ratio of these."""
    system, pieces = trajectory.system, trajectory.pieces
    y = np.max([piece.kept_path.largest for piece in pieces], axis=0)
    numbers = np.arange(len(pieces)).repeat(2)
    taus = np.array([tau for piece in pieces for tau in (0.0, piece.end)])
    q = np.abs(trajectory.loads_at(numbers, taus)).max(axis=1)
    velocity = max(y[: system.n].max(initial=0.0), system.drive_velocities(q).max(initial=0.0))
    length = y[system.n : system.first_bristle].max(initial=0.0) or velocity * taus.sum()
    pressed = system.abs_GT @ (system.largest_coefficient * q[: system.m])
    # springs far from the origin carry no larger forces: these are sums over both of their ends
    states = np.concatenate([piece.kept_path.points[[0, -1]] for piece in pieces]).T
    sprung = np.abs(system.C @ states).max(axis=1, initial=0.0)
    force = (sprung + system.abs_Q @ q + pressed).max(initial=0.0)
    known = {
        **dict.fromkeys(("rest", "upper", "lower", "position"), length),
        "velocity": velocity,
        **dict.fromkeys(("normal", "signal"), force),
        "stiffness": force / length if length else 0.0,
        "damping": force / velocity if velocity else 0.0,
    }
    return float(known.get(field, 0.0))


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
