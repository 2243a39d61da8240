"""Derivatives of a simulated motion with respect to parameters of its scene, exact through events."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from stickslip.engines import MethodName
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array
from stickslip.model.checks import numbers
from stickslip.model.elements import GROUND
from stickslip.model.scene import Scene
from stickslip.simulation.arguments import Times
from stickslip.simulation.result import Result
from stickslip.studies.derivatives import kinks
from stickslip.studies.derivatives.directions import along_parameter
from stickslip.studies.derivatives.variations import Variation, simulated
from stickslip.studies.derivatives.varied_integrals import integral
from stickslip.studies.parameters import named_parameters

# Tolerances of the simulation where the engine needs some: derivatives are about as accurate.
_RTOL, _ATOL = 1e-11, 1e-13


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of a motion with respect to parameters.

    Where a derivative does not exist (a guard grazes, an event falls on a break of a load or together with another),
    it is NaN from that time on, and `reasons` says why.

    Attributes
    ----------
    parameters : tuple of str
    result : Result
        The motion itself.
    events : array (events, parameters)
        Derivatives of the times of ``result.events``, in s per unit of the parameter.
    reasons : tuple of str
        Where derivatives do not exist.
    """

    parameters: tuple[str, ...]
    result: Result = field(repr=False)
    events: Array
    reasons: tuple[str, ...]
    variation: Variation = field(repr=False)

    def velocity(self, body: str, times: Sequence[float] | Array | None = None) -> Array:
        """Return the derivatives of the velocity of a body or drive at fixed times, by default at the end.

        Parameters
        ----------
        body : str
        times : array (k,), optional
            In s; right limits at events.

        Returns
        -------
        array (parameters,) or (k, parameters)

        Raises
        ------
        ValueError
            If there is no such body, or a time lies outside.
        """
        return self._read(lambda at: self._velocity(body, at), times)

    def position(self, body: str, times: Sequence[float] | Array | None = None) -> Array:
        """Return the derivatives of the position of a body or drive at fixed times, by default at the end.

        Times and shape are those of `velocity`.

        Raises
        ------
        ValueError
            If there is no such body, or a time lies outside.
        """
        return self._read(lambda at: self._position(body, at), times)

    def force(self, contact: str, times: Sequence[float] | Array | None = None) -> Array:
        """Return the derivatives of the force of a contact or another row at fixed times, by default at the end.

        Times and shape are those of `velocity`.

        Raises
        ------
        ValueError
            If there is no such row, or a time lies outside.
        """
        row = self.result.samples.row(contact)

        def force(motion: Motion, taus: Array, y: Array) -> Array:
            return np.asarray(motion.row_forces(taus, y)[row])

        return self._read(lambda at: self.variation.quantity(force, at), times)

    def heat(self, contact: str, times: Sequence[float] | Array | None = None) -> Array:
        """Return the derivatives of the heat of a contact from the start to fixed times, by default to the end.

        ``heat = integral of r w dt``, in J; for a gap the energy that it stores is part of it. Times and shape are
        those of `velocity`.

        Raises
        ------
        ValueError
            If there is no such contact, or a time lies outside.
        """
        row = self.result.samples.row(contact)
        if times is None:
            return np.asarray(self._heats[row])
        return self._read(lambda at: integral(self.variation, _powers, at)[row], times)

    @cached_property
    def _heats(self) -> Array:
        """Derivatives of the heats of all rows at the end."""
        last = self.result.trajectory.pieces[-1].stop
        return integral(self.variation, _powers, np.array([last]))[:, 0]

    def _read(self, read: Callable[[Array], Array], times: Sequence[float] | Array | None) -> Array:
        last = self.result.trajectory.pieces[-1].stop
        at = np.array([last]) if times is None else numbers(np.atleast_1d(times), "times")
        order = np.argsort(at, kind="stable")
        found = np.empty((at.size, len(self.parameters)))
        found[order] = read(at[order])
        return found[0] if times is None or np.ndim(times) == 0 else found

    def _velocity(self, body: str, at: Array) -> Array:
        i = self.result.samples.body(body)
        if body == GROUND:
            return np.zeros((at.size, len(self.parameters)))
        if i < self.variation.system.n:
            return np.asarray(self.variation.states(at)[i])
        return np.asarray(self.variation.quantity(_velocity_of(i), at)[0])

    def _position(self, body: str, at: Array) -> Array:
        i = self.result.samples.body(body)
        system = self.variation.system
        if body == GROUND:
            return np.zeros((at.size, len(self.parameters)))
        if i in system.position_state:
            return np.asarray(self.variation.states(at)[system.position_state[i]])
        start = np.array([one.positions[i] for one in self.variation.directions])
        return np.asarray(integral(self.variation, _velocity_of(i), at)[0] + start)

    def __str__(self) -> str:
        """Return the derivatives of the event times as a table."""
        width = max(map(len, self.parameters))
        lines = []
        for event, row in zip(self.result.events, self.events, strict=True):
            lines.append(str(event))
            named = zip(self.parameters, row, strict=True)
            lines += [f"    dt / d {name.ljust(width)}  {value: .9g}" for name, value in named]
        return "\n".join([*(lines or ["no events"]), *self.reasons])


def sensitivities(
    scene: Scene,
    t_span: Times,
    parameters: Iterable[str],
    *,
    method: MethodName = "auto",
    rtol: float = _RTOL,
    atol: float = _ATOL,
) -> Sensitivities:
    """Return the derivatives of event times, velocities, positions, forces and heats with respect to parameters.

    Between events ``S = dy/dp`` follows ``S' = f_y S + f_p``; the time of an event at ``g = 0`` has the derivative
    ``-(g_p + g_y S) / g'``, and S jumps there (saltation). With the series these derivatives are accurate to about
    1e-10 of their size; else they are as accurate as the simulation.

    Parameters
    ----------
    scene : Scene
    t_span : (float, float)
        Start and end in s.
    parameters : sequence of str
        ``"wheel.inertia"``, ``"block.velocity"``, ``"brake.law.mu_coulomb"``, ``"springs[0].stiffness"``,
        ``"brake.normal.scale"`` (a factor of any load). Where the numbers of a gear or tie change, the velocities at
        the start change with them, as after an impulse that makes the tie hold.
    method, rtol, atol
        As `simulate` takes them.

    Returns
    -------
    Sensitivities

    Raises
    ------
    ValueError, TypeError
        If a name leads to no number of the scene, or the scene has another structure at values near by.
    SimulationError
        If the simulation cannot go on.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"sensitivities: scene must be a Scene, got {type(scene).__name__}")
    named = named_parameters(scene, parameters, "sensitivities")
    result = simulated(scene, t_span, method=method, rtol=rtol, atol=atol)
    directions = [along_parameter(scene, one, result.trajectory, "sensitivities") for one in named]
    variation = Variation(result, directions)
    for k, why in (*kinks.at_dwells(variation), *kinks.off_hold_at_start(variation)):
        variation.give_up(k, why)
    return from_variation(variation)


def from_variation(variation: Variation) -> Sensitivities:
    """Return the derivatives that a variation holds."""
    result, names = variation.result, tuple(one.name for one in variation.directions)
    return Sensitivities(names, result, _event_changes(variation), _reasons(variation), variation)


def _event_changes(variation: Variation) -> Array:
    """Return the derivatives of the times of the events of a result, one line each."""
    found = np.full((len(variation.result.events), variation.count), np.nan)
    pieces = variation.trajectory.pieces[:-1]
    changes = {piece.stop: varied.end_change for piece, varied in zip(pieces, variation.pieces, strict=False)}
    # an event at the start stays at the start: the derivative of its time is 0
    begun = np.isfinite(variation.pieces[0].at(np.zeros(1))[:, 0]).all(axis=0)
    changes[variation.trajectory.span.start] = np.where(begun, 0.0, np.nan)
    relaxed = {event.t for event in variation.result.events if event.cause == "relaxation"}
    for i, event in enumerate(variation.result.events):
        if event.t in changes and event.t not in relaxed:
            found[i] = changes[event.t]
    return found


def _reasons(variation: Variation) -> tuple[str, ...]:
    said = [
        f"no derivative with respect to {variation.directions[k].name!r} from t = {t:.9g} s on: {why}"
        for t, k, why in variation.reasons
    ]
    for event in variation.result.events:
        if event.cause == "relaxation":
            said.append(
                f"no derivative of the event at t = {event.t:.9g} s: {event.contact!r} comes to rest without crossing "
                "0, at a time that depends on the velocity margin"
            )
    return tuple(said)


def _velocity_of(i: int) -> Callable[[Motion, Array, Array], Array]:
    def velocity(motion: Motion, taus: Array, y: Array) -> Array:
        system = motion.system
        return np.asarray(y[[i]] if i < system.n else system.drive_velocities(motion.loads(taus))[[i - system.n]])

    return velocity


def _powers(motion: Motion, taus: Array, y: Array) -> Array:
    w = motion.system.relative_velocity(y, motion.loads(taus))
    return np.asarray(motion.row_forces(taus, y) * w)
