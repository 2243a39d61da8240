"""A knot as a scene of its own: what an event changes in it is settled without the rest of the scene.

Rows join the bodies of a knot to each other, to drives and to the ground only. The bodies to which springs, dampers and
gaps couple them do not jump and feel the event through these alone, so that for an instant they are drives that go on
with their velocities and accelerations.
"""

from __future__ import annotations

from collections import defaultdict
from functools import lru_cache

import numpy as np

from stickslip.engines.part_by_part.knots import Knot
from stickslip.engines.part_by_part.parts import Parts
from stickslip.equations.algebra.matrices import dense
from stickslip.equations.loads.loads import Segment
from stickslip.equations.mode_equations import ModeEquations
from stickslip.equations.system import System
from stickslip.events.endings import open_from_here
from stickslip.events.impact import Jammed
from stickslip.events.settle import Settled, settle
from stickslip.events.situation import Inconsistent, Situation, Uncertainty
from stickslip.model.arrays import Array, Indices, Mask
from stickslip.model.elements import Body, Drive, Force
from stickslip.model.elements.base import Element
from stickslip.model.elements.book import GROUND
from stickslip.model.scene import Scene

_REMEMBERED = 2000  # scenes of knots that are kept: with their equations some 150 kB each where a knot has one body


class KnotScenes:
    """The scenes of the knots of a system, each made when it is needed; the latest are remembered."""

    def __init__(self, system: System, knots: list[Indices]) -> None:
        self._system, self._knots = system, knots
        self._remembered = lru_cache(maxsize=_REMEMBERED)(self._made)
        self._acting: dict[str, list[int]] = defaultdict(list)
        self._number_of_force: dict[int, int] = {}
        for place, element in enumerate(system.scene.elements):
            for name in _members(element):
                self._acting[name].append(place)
            if isinstance(element, Force):
                self._number_of_force[place] = len(self._number_of_force)

    def __getitem__(self, number: int) -> KnotScene | None:
        """Return the scene of a knot, None where forces that follow the motion act on it: they may read all others."""
        return self._remembered(number)

    def _made(self, number: int) -> KnotScene | None:
        system, bodies = self._system, self._knots[number]
        elements = system.scene.elements
        places = sorted({k for i in bodies.tolist() for k in self._acting[system.names[i]]})
        if any(elements[k].quantities() for k in places):
            return None
        forces = [self._number_of_force[k] for k in places if isinstance(elements[k], Force)]
        return KnotScene(system, bodies, [elements[k] for k in places], forces)


class KnotScene:
    """One knot, the drives that act on it, and the bodies coupled to it as drives.

    Parameters
    ----------
    system : System
        The whole scene.
    bodies : array (k,) of int
        The bodies of the knot.
    acting : list of Element
        The bodies and all that acts on them.
    forces : list of int
        The numbers of the forces among these in the whole scene.

    Attributes
    ----------
    rows : array of int
        The rows of the scene as the whole scene numbers them, those of gaps too.
    is_gap : array of bool
        Which of these are gaps.
    """

    def __init__(self, system: System, bodies: Indices, acting: list[Element], forces: list[int]) -> None:
        self._whole = system
        names = dict.fromkeys(name for element in acting for name in _members(element))
        own = {system.names[i] for i in bodies.tolist()}
        others = [name for name in names if name not in own and name != GROUND]
        stand_in = [Drive(name, velocity=0.0) for name in others]
        self.system = own_system = System(Scene(*acting, *stand_in))
        self.bodies = bodies
        self.rows = np.array([system.row_index[row.name] for row in own_system.rows], dtype=np.intp)
        self.is_gap = own_system.is_gap
        numbers = np.array([system.index[name] for name in others], dtype=np.intp)
        # the drives of the whole scene, -1 for bodies; and the bodies, -1 for drives
        lead = self._drives = np.where(numbers >= system.n, numbers - system.n, -1)
        self._beside = np.where(numbers < system.n, numbers, -1)
        parts = [
            self.rows,
            system.first_force + np.array(forces, dtype=np.intp),
            np.where(lead >= 0, system.first_drive + lead, -1),
            np.where(lead >= 0, system.first_acceleration + lead, -1),
            np.array([system.inputs - 1]),
        ]
        # where each input stands in the whole scene, -1 for the motion of bodies
        self._source = np.concatenate(parts)
        self._knots: dict[bytes, Knot] = {}

    def knot_in(self, equations: ModeEquations) -> Knot:
        """Return the knot in the modes of equations of its scene."""
        key = equations.modes.tobytes()
        found = self._knots.get(key)
        if found is None:
            whole, system, held = self._whole, self.system, equations.held
            D = np.zeros((held.size, whole.drives))
            led = (self._drives >= 0).nonzero()[0]
            D[:, self._drives[led]] = dense(system.D[held])[:, led]
            shares = np.empty((0, system.n)) if equations.shares is None else dense(equations.shares)
            matrices = dense(system.G[held]), D, shares
            found = Knot(whole, self.bodies, self.rows[held], self.rows[equations.at_level], matrices)
            self._knots[key] = found
        return found

    def settled(
        self, parts: Parts, segment: Segment, t: float, fired: Mask, arrived: Mask, uncertain: Uncertainty
    ) -> Settled | None:
        """Return how the knot goes on at time `t` of a segment, None where only the whole scene can tell.

        `fired` are which of its rows have been found at their limit, `arrived` which open ones have come to rest.
        """
        own, rows = self._segment(parts, segment, t), self.rows
        situation = self._situation(parts, t, fired)
        stops = open_from_here(self.system, parts.mode[rows], own.at(t)) & arrived
        labels = np.where(stops, 0, parts.label[rows]).astype(np.int8)
        situation = situation._replace(labels=labels, touching=situation.touching | stops, arrived=stops)
        of_rows = uncertain._replace(velocity_resolution=uncertain.velocity_resolution[rows])
        try:
            found = settle(self.system, own, situation, of_rows)
        except (Inconsistent, Jammed):
            return None
        return found if (found.motion.equations.regions == situation.regions).all() else None

    def _situation(self, parts: Parts, t: float, fired: Mask) -> Situation:
        """Return what is known at time `t`."""
        system, rows, bodies = self.system, self.rows, self.bodies
        v, x = parts.at(bodies, t)
        y = np.zeros(system.size)
        y[: system.n], y[system.moved_state] = v, x[system.moved]
        y[system.carried_state] = self._positions(parts, t)[system.carried]
        largest = np.abs(y)
        largest[: system.n] = np.maximum(largest[: system.n], parts.speed[bodies])
        mode, label = parts.mode[rows], parts.label[rows]
        since = np.where(label == 0, parts.since[rows], t)
        elastic, functions = parts.elastic, rows[system.piecewise.row]
        regions = elastic.region[elastic.number[functions]]
        touching = fired & (mode != 0) | (label == 0)
        sides = np.where(system.is_stop & (mode == 0), label, 0).astype(np.int8)
        return Situation(t, y, label, since, touching, fired, largest, regions, sides)

    def _positions(self, parts: Parts, t: float) -> Array:
        """Return the positions of the drives, and of bodies that are drives here."""
        found = np.zeros(self._drives.size)
        led, beside = (self._drives >= 0).nonzero()[0], (self._beside >= 0).nonzero()[0]
        found[led] = parts.prescribed.drives.positions(self._drives[led], np.array([t]))[:, 0]
        found[beside] = parts.at(self._beside[beside], t)[1]
        return found

    def _segment(self, parts: Parts, segment: Segment, t: float) -> Segment:
        """Return the loads of a segment on the knot, and the motion at time `t` of what acts on it."""
        source, system = self._source, self.system
        # those that stand nowhere in the whole scene are entered below
        value, slope = segment.value[source], segment.slope[source]
        beside = (self._beside >= 0).nonzero()[0]
        v, a = parts.rates(self._beside[beside], t)
        at = system.first_drive + beside
        value[at], slope[at] = v - a * (t - segment.start), a
        at = system.first_acceleration + beside
        value[at], slope[at] = a, 0.0
        # every input of the whole scene stands in this one once at most
        entry, own = (segment.sines.entry[:, None] == source).nonzero()
        sines = zip(own.tolist(), *segment.sines.numbers[:, entry].tolist(), strict=True)
        return Segment(segment.start, segment.stop, value, slope, list(sines), [], False)


def _members(element: Element) -> list[str]:
    """Return the names of the bodies and drives that an element is, joins or acts on."""
    if isinstance(element, Body):
        return [element.name]
    return [element.body] if isinstance(element, Force) else list(getattr(element, "coefficients", ()))
