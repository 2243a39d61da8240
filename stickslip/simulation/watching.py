"""Events of the user: where quantities cross 0, or come to it and stay, along the paths of a run.

They change nothing in the motion, so they are looked for on the polynomials of its steps. In each step the polynomial
through the values at Chebyshev points stands for the quantity; a root is then refined on the quantity itself.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from stickslip.engines.part_by_part.parts import Parts
from stickslip.equations.loads.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes, from_nodes
from stickslip.equations.system import System
from stickslip.model.arrays import Array
from stickslip.model.when import When
from stickslip.simulation.signs import DEGREE, ROUGH, TINY, signs_along

# How often a step in which a quantity is no such polynomial is halved at most, and how many parts at once.
_HALVINGS, _AT_MOST = 16, 1000

# A quantity is no such polynomial where one of this many last terms is above this part of the sum of all varying ones.
# Where its constant term is beyond so many times that sum, it stays off 0 all the same.
_LAST, _RESOLVED, _FAR = 4, 1e-9, 4.0

# A quantity that bends to 0 and stays there is off 0 by so many times its noise shortly before. Shortly is this part of
# the shorter of the two parts about. One that stays at 0 from the start of a path does so for longer than this part.
_SHORTLY, _OFF = 1e-3, 10.0

_LOOKS = 200  # places along a path that are tried to find where a function fails
_PARTS = 4  # parts of the shortest period of the loads within which a quantity is a polynomial


class Crossing(NamedTuple):
    """A user's event at local time `tau` of a motion: the sign that the quantity comes to, unless it `stays` at 0."""

    tau: float
    event: When
    sign: int
    stays: bool = False


class Failed(Exception):
    """The function of an event has failed: not before local time `tau`."""

    def __init__(self, fault: Exception, tau: float) -> None:
        super().__init__(str(fault))
        self.tau = tau


class Watch:
    """Watches the quantities of the user's events, path by path.

    The system is compiled with these quantities as the observed ones. `in_steps` says that a method of fixed steps
    follows the motion: it goes beyond 0 before it finds a contact stuck there.
    """

    def __init__(self, system: System, events: Sequence[When], loads: Loads, in_steps: bool) -> None:
        self._system, self._events, self._loads, self._in_steps = system, list(events), loads, in_steps
        self._signs = [0] * len(self._events)
        # whether a quantity was roundoff at the end of the last path, and whether it crossed 0 there
        self._died, self._passed = [False] * len(self._events), [False] * len(self._events)
        # the largest value of each quantity since it left 0
        self._largest = [0.0] * len(self._events)
        # how far stops have had the bodies from the origin: impacts leave positions, and so their roundoff, as they are
        reach = np.asarray(system.abs_GT @ system.is_stop)
        self._struck = system.n + reach[system.moved].nonzero()[0]
        self._farthest = np.zeros((self._struck.size, 1))

    def crossings(self, motion: Motion, path: Path) -> list[Crossing]:
        """Return the events along a path in order of time, up to the first that stops the simulation.

        Where the function of one fails, `Failed` is raised.
        """
        gained = np.zeros(self._system.size)
        if path.taus.size > 1:
            n = self._system.n
            gained[:n] = motion.rate_majorants()[:n] * np.diff(path.taus).max()
        return self._between(path.taus, lambda taus: self._values(motion, path, taus, gained))

    @property
    def reads_series(self) -> bool:
        """Whether the quantities read states and loads only, and no friction, which needs modes of the whole scene."""
        return not self._system.observes_heat

    def crossings_of_parts(self, motion: Motion, parts: Parts, begin: float, end: float) -> list[Crossing]:
        """Return the events of a scene that is followed part by part, between two changes of its series.

        `motion` is where the parts have begun. Local times run from `begin`.
        """
        system = self._system
        gained, at_start = parts.gained(system.observed_states, begin), np.abs(motion.start_inputs)

        def values(taus: Array) -> tuple[Array, Array]:
            t = begin + taus
            (y, sizes), since = parts.some_states(system.observed_states, t), t - motion.t
            if system.observes_inputs:
                q = motion.inputs(since, y, system.for_observed)[: system.inputs]
            else:
                q = np.zeros((system.inputs, t.size))
                q[-1] = 1.0
            majorants = at_start[: system.inputs, None], self._with_earlier(sizes) + gained[:, None]
            return system.observed_values(q, y, majorants, t, since, motion.friction_of)

        return self._between(np.array([0.0, end - begin]), values)

    def _between(self, ends: Array, values: Callable[[Array], tuple[Array, Array]]) -> list[Crossing]:
        """Return the events between the `ends` of steps; in these the quantities are smooth."""
        found: list[Crossing] = []
        try:
            edges, at_nodes, majorants = self._at_nodes(ends, values)
            for k in range(len(self._events)) if edges.size > 1 else ():
                size = float(majorants[k].max(initial=0.0))
                found += self._of_event(k, edges, at_nodes[k], size, _one(values, k))
        except (ArithmeticError, ValueError) as fault:
            raise Failed(fault, _last_known(values, float(ends[-1]))) from fault
        wanted = [one for one in found if one.event.direction in (0, one.sign)]
        wanted.sort(key=lambda one: one.tau)
        stops = [one for one in wanted if one.event.stop]
        return [one for one in wanted if one.tau <= stops[0].tau] if stops else wanted

    def _of_event(
        self, k: int, edges: Array, values: Array, size: float, exact: Callable[[float], float]
    ) -> list[Crossing]:
        """Return where the quantity of one event crosses 0, or comes to it and stays, between the `edges` of parts.

        `values` are those at the Chebyshev points of each part, `size` is their largest majorant, and `exact` is the
        quantity itself.
        """
        event, sign = self._events[k], self._signs[k]
        rough, noise = ROUGH * size, TINY * size
        found: list[Crossing] = []
        first = values[0, 0]
        if sign and abs(first) > rough and (first > 0) != (sign > 0):
            # the quantity has jumped
            sign = -sign
            found.append(Crossing(0.0, event, sign))
        at_0 = [bool(np.all(np.abs(row) <= noise)) for row in values]
        leaves = edges[at_0.index(False)] if False in at_0 else edges[-1]
        if sign and all(at_0[:2]) and leaves > _SHORTLY * edges[-1] and not self._died[k]:
            # It stays at 0, as the velocity of a stuck contact does. Two parts and a time are looked at: what leaves 0
            # is roundoff in short parts. If all values that gave the sign are roundoff here, there has never been one.
            if self._largest[k] > noise and not (self._in_steps and self._passed[k]):
                found.append(Crossing(0.0, event, -sign, stays=True))
            sign = 0
        self._passed[k] = False
        lengths = np.diff(edges)
        for left, row in enumerate(values):
            if sign and left and at_0[left] and not at_0[left - 1]:
                tau = _first_at_0(exact, edges[left - 1], edges[left], noise)
                before = tau - _SHORTLY * min(lengths[left - 1 : left + 1])
                if abs(exact(before)) > _OFF * noise:
                    # it bends there and stays, like a quantity that is cut off: it neither dies away nor goes through
                    found.append(Crossing(tau, event, -sign, stays=True))
                    sign = 0
            least = rough if sign == 0 else noise
            for tau, now in signs_along(edges[left], edges[left + 1], row, exact, least, noise):
                if sign == -now:
                    found.append(Crossing(tau, event, now))
                    self._passed[k] = left == len(at_0) - 1
                sign = now
        self._largest[k] = max(self._largest[k], float(np.abs(values).max())) if sign else 0.0
        self._signs[k], self._died[k] = sign, at_0[-1]
        return found

    def _at_nodes(self, ends: Array, values_at: Callable[[Array], tuple[Array, Array]]) -> tuple[Array, Array, Array]:
        """Return the ends of parts of steps, the quantities in each at Chebyshev points, and their majorants.

        Steps are halved in which a quantity is not the polynomial through these values, unless it is far from 0.
        """
        edges = np.union1d(ends, self._loads.periods(0.0, float(ends[-1]), _PARTS))
        nodes, to_series = chebyshev_nodes(DEGREE), from_nodes(DEGREE)
        left, length = edges[:-1], np.diff(edges)
        done: list[tuple[Array, Array, Array]] = []
        for count in range(_HALVINGS + 1):
            taus = left[:, None] + length[:, None] * nodes
            values, majorants = values_at(taus.ravel())
            values, majorants = (one.reshape(len(self._events), *taus.shape) for one in (values, majorants))
            done.append((left, values, majorants))
            c = np.abs(values @ to_series.T)
            varies = c[:, :, 1:].sum(axis=2)
            rough = c[:, :, -_LAST:].max(axis=2) > _RESOLVED * varies + ROUGH * majorants.max(axis=2)
            halved = (rough & (c[:, :, 0] <= _FAR * varies)).any(axis=0)
            if count == _HALVINGS or not 0 < halved.sum() <= _AT_MOST:
                break
            done[-1] = left[~halved], values[:, ~halved], majorants[:, ~halved]
            length = np.repeat(0.5 * length[halved], 2)
            left = np.repeat(left[halved], 2)
            left[1::2] += length[1::2]
        starts = np.concatenate([one[0] for one in done])
        order = np.argsort(starts)
        values, majorants = (np.concatenate([one[k] for one in done], axis=1)[:, order] for k in (1, 2))
        return np.append(starts[order], edges[-1]), values, majorants

    def _with_earlier(self, sizes: Array) -> Array:
        """Return the sizes of states, a column per time, where those of positions at stops are the largest so far."""
        if self._struck.size:
            at_stops = sizes[self._struck]
            self._farthest = np.maximum(self._farthest, at_stops.max(axis=1, keepdims=True, initial=0.0))
            sizes[self._struck] = self._farthest
        return sizes

    def _values(self, motion: Motion, path: Path, taus: Array, gained: Array) -> tuple[Array, Array]:
        """Return the quantities at local times, a line each, and their majorants.

        `gained` are majorants of what forces add to the states: where forces cancel they leave roundoff.
        """
        y = motion.exact(taus, path.at(taus).T)
        q = motion.inputs(taus, y, self._system.for_observed)[: self._system.inputs]
        majorants = np.zeros(1), self._with_earlier(np.abs(y)) + gained[:, None]
        return self._system.observed_values(q, y, majorants, motion.t + taus, taus, motion.friction_of)


def _last_known(values: Callable[[Array], tuple[Array, Array]], end: float) -> float:
    """Return a local time shortly before the function of an event fails."""
    known = 0.0
    with contextlib.suppress(ArithmeticError, ValueError):
        for tau in np.linspace(0.0, end, _LOOKS).tolist():
            values(np.array([tau]))
            known = tau
    return known


def _one(values: Callable[[Array], tuple[Array, Array]], k: int) -> Callable[[float], float]:
    """Return one quantity as a function of the local time."""
    return lambda tau: float(values(np.array([tau]))[0][k, 0])


def _first_at_0(value: Callable[[float], float], left: float, right: float, noise: float) -> float:
    """Return the time from which on a quantity is 0, but for noise: it is at `right`, and not long before."""
    while left < (middle := 0.5 * (left + right)) < right:
        if abs(value(middle)) <= noise:
            right = middle
        else:
            left = middle
    return right
