"""A scene as constants: its states, its inputs, its rows, and the matrices between them.

Everything is linear in the state ``y = (velocities, positions, bristles, blocks)``, in the inputs
``q = (normal forces, forces, loads and functions that quantities are made of, drive velocities, drive accelerations,
1)`` and in the friction forces of rows whose law depends on velocity. Only bodies have a position that a spring touches
or whose position is read.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import Triplets
from stickslip.equations.balance import Balance, Components, components_of
from stickslip.equations.loads.dependence import Dependence, Forms, Friction
from stickslip.equations.loads.loads import Loads, Segment
from stickslip.equations.loads.reader import BlockPlace, Form, Key, Node, Reader
from stickslip.equations.loads.sums import made_of_others
from stickslip.equations.piecewise import PiecewiseMatrices
from stickslip.equations.transmission import Transmission
from stickslip.model.arrays import Array, Indices, Mask, like
from stickslip.model.elements import Block, Sampled, StateSpace
from stickslip.model.elements.book import Book
from stickslip.model.laws.dry_friction import DryFriction
from stickslip.model.laws.table import LawTable
from stickslip.model.quantities import Expression, Output, Position, RelativeVelocity, Stretch, as_expression
from stickslip.model.scene import Scene
from stickslip.model.signals import ZERO, Constant, Load, PiecewiseLinear, Signal

# Number of bodies and rows beyond which matrices are sparse: up to it, products of dense ones take less time.
_DENSE_LIMIT = 220

# How many sets of modes of a large scene are remembered; and for smaller scenes, the memory for them in bytes.
_REMEMBERED_SPARSE, _MODE_BYTES = 4, 25_000_000

# Most balances of forces that are kept, and memory for them in bytes: results are read with those of the run.
_BALANCES, _BYTES = 4000, 32_000_000

_NO_LAW = DryFriction(0.0, 0.0)


class CouplingForces:
    """The forces of springs and dampers, or gaps, one by one: in the sums over bodies those of far ends cancel."""

    def __init__(self, levers: Any, of_states: Any, of_inputs: Any, to_ground: Mask) -> None:
        """Take the sizes of the levers on the bodies, and what forces have of states and inputs, a line each."""
        self._levers, self._C, self._Q, self._to_ground = levers, of_states, of_inputs, to_ground
        self._abs_C, self._abs_Q = abs(of_states), abs(of_inputs)

    def sizes(self, y: Array, q: Array) -> Array:
        """Return the sums of the sizes of these forces on the bodies, those of all terms where one end is the ground.

        The roundoff of terms acts on both ends, and leaves the sum of all forces exact, but at the ground.
        """
        forces = np.abs(self._C @ y + self._Q @ q)
        if self._to_ground.any():
            terms = self._abs_C @ np.abs(y) + self._abs_Q @ np.abs(q)
            forces = np.where(self._to_ground, terms, forces)
        return np.asarray(self._levers @ forces)


class System:
    """A scene compiled to constant matrices. It never changes.

    `observed` are further quantities that can be computed, each after its label in messages: nothing depends on them.

    Attributes
    ----------
    n, drives, m, size, inputs : int
        Numbers of bodies, drives, rows, states and inputs.
    inputs_and_dwells : int
        The number of inputs followed by ``exp(-age / dwell) N`` of the rows with a dwell time.
    G, D : array or sparse (m, n), (m, drives)
        Coefficients of the rows on bodies and drives.
    C, Q : array or sparse (n, size), (n, inputs)
        Forces on the bodies from states and inputs.
    push_C, push_Q : array or sparse (n, size), (n, inputs)
        The part of C and Q that comes from loads.
    dependence : Dependence or None
        The inputs that depend on the state, if there are any.
    clocked : array of int
        States of sampled blocks: they change at samples only.
    pressed : array (m,) of bool
        Rows whose normal force depends on the state: guards tell where they open and close.
    generic : bool
        Whether coincidences of the scene are disregarded: a function or load that several elements read is a separate
        input for each, and points on a straight line of a load are breaks. So scenes near by have the same inputs and
        breaks.
    """

    def __init__(self, scene: Scene, observed: Sequence[tuple[str, Load]] = (), generic: bool = False) -> None:
        self.scene, self.observed, self.generic = scene, tuple(observed), generic
        book = Book(scene.elements, [load for _, load in observed])
        self.index, self.rows, self.row_index = book.index, book.rows, book.row_index
        self.couplings = book.couplings
        self.names = [body.name for body in book.bodies]
        n, drives, m = len(book.bodies), len(book.drives), len(book.rows)
        self.n, self.drives, self.m = n, drives, m
        self.sparse = n + m > _DENSE_LIMIT
        self.inertia = np.array([body.inertia for body in book.bodies])
        self._place_states(book)
        self._place_inputs(book)
        self._place_laws(book)
        self._join(book)
        self._push(book)
        self.piecewise = self._piecewise(book)
        # the memory of one set of modes is measured
        remembered = _REMEMBERED_SPARSE if self.sparse else _MODE_BYTES // (60_000 + 20 * (n + m) ** 2)
        self.remembered = lru_cache(maxsize=remembered)(self._made)
        each = 100 * (n + m) if self.sparse else 16 * (n + m) ** 2
        self._balances = lru_cache(maxsize=max(min(_BYTES // each, _BALANCES), _REMEMBERED_SPARSE))(self._balance)
        self._joined = lru_cache(maxsize=1)(self._numbered)
        self._components = Components(self.inertia, self.G, self.D, self.independent)
        self._loads = lru_cache(maxsize=1)(self._made_loads)

    def _place_states(self, book: Book) -> None:
        stretched = {i for c in book.couplings if c.stiffness for i in c.coefficients}
        stretched.update(i for row in book.rows if row.regions for i in row.coefficients)
        read: dict[str, int] = {}
        for quantity in book.quantities():
            match quantity:
                case Position(body=body):
                    stretched.add(book.index[body])
                case Stretch(row=row):
                    stretched.update(book.rows[book.row_index[row]].coefficients)
                case Output(block=name, index=index):
                    read[name] = max(read.get(name, 1), index + 1)
        # the ground stays where it is
        stretched.discard(self.n + self.drives)
        placed = self.placed = np.array(sorted(stretched), dtype=np.intp)
        self.position_state = {int(i): self.n + k for k, i in enumerate(placed)}
        # bodies and drives whose positions are states, and where these stand
        self.moved, self.carried = placed[placed < self.n], placed[placed >= self.n] - self.n
        self.first_bristle = self.n + placed.size
        self.moved_state = np.arange(self.n, self.n + self.moved.size)
        self.carried_state = np.arange(self.n + self.moved.size, self.first_bristle)
        c = self.laws = LawTable([row.law or _NO_LAW for row in book.rows])
        bristles = np.flatnonzero(c.has_state)
        self.bristle_state = {int(j): self.first_bristle + k for k, j in enumerate(bristles)}
        self.size = self.first_block = self.first_bristle + bristles.size
        self.blocks: dict[str, BlockPlace] = {}
        for block in book.blocks:
            states = len(block.states or ())
            outputs = block.output_count or read.get(block.name, 1)
            place = BlockPlace(block, self.size, states, self.size + states, outputs)
            self.blocks[block.name], self.size = place, place.end

    def _place_inputs(self, book: Book) -> None:
        """Resolve what forces, blocks and events of the user depend on, and give every input its place."""
        reader = self.reader = Reader(
            book, self.position_state, self.bristle_state, self.blocks, shares=not self.generic
        )
        forces = [_parts(load) for _, load, _ in book.forces]
        pressed = [_parts(row.normal) for row in book.rows]
        self.normals = [own for own, _ in pressed]
        self.pressed = np.array([linear is not None for _, linear in pressed], dtype=bool)
        # to read a form makes inputs of its signals and functions
        self.pushes = [
            (i, reader.form(linear, label))
            for (i, _, label), (_, linear) in zip(book.forces, forces, strict=True)
            if linear is not None
        ]
        self._presses = normals = {
            j: reader.form(linear, f"the normal force of contact {book.rows[j].name!r}")
            for j, (_, linear) in enumerate(pressed)
            if linear is not None
        }
        self._rates = {
            place.first + k: form for place in self.blocks.values() for k, form in enumerate(reader.rates(place.block))
        }
        sampled = [
            (place, place.block, [reader.form(u, place.block.label) for u in place.block.quantities()])
            for place in self.blocks.values()
            if isinstance(place.block, Sampled)
        ]
        # the forms on which each state of a block depends
        self._given_to = {state: [form] for state, form in self._rates.items()}
        for own, _, forms in sampled:
            self._given_to |= dict.fromkeys(range(own.first, own.end), forms)
        acting = len(reader.nodes)
        observed = [reader.form(load, label) for label, load in self.observed]
        self._number_inputs(book, [own for own, _ in forces])
        place, first_of_node = self._place, self._first_of_node.tolist()
        self.sampled = [(own, block, Forms.of(forms, place)) for own, block, forms in sampled]
        clocked = [np.arange(own.first, own.end) for own, _, _ in sampled]
        self.clocked = np.concatenate([np.empty(0, dtype=np.intp), *clocked])
        nodes = reader.nodes[:acting]
        self.dependence = Dependence(nodes, first_of_node[0], normals, place) if nodes or normals else None
        self._observed = Forms.of(observed, place)
        self._place_observed(reader.nodes[acting:], first_of_node[acting])

    def _place_observed(self, nodes: Sequence[Node], first: int) -> None:
        """Note what observed quantities depend on; `nodes`, at input `first`, are functions that only they read."""
        self._only_observed = Dependence(nodes, first, {}, self._place)
        read = [self._observed, *self._only_observed.arguments]
        places = [at for forms in read for at in forms.places.tolist()]
        # the nodes of the motion itself on which observed quantities depend
        self.for_observed = self.dependence.before(places) if self.dependence is not None else frozenset()
        self.observed_states = np.unique(np.concatenate([forms.states for forms in read]))
        beside = {*range(first, self.first_drive), self.inputs - 1}
        # whether an observed quantity reads loads or drives; functions that only they read do not count
        self.observes_inputs = not beside.issuperset(places)
        self.observes_heat = self._only_observed.has_heat

    def _number_inputs(self, book: Book, forces: Sequence[Signal]) -> None:
        """Number the inputs: normal forces, forces, signals, functions, velocities and accelerations of drives, 1."""
        widths = [node.width for node in self.reader.nodes]
        signals = self.reader.signals
        velocities = [drive.velocity for drive in book.drives]
        self.others = [*forces, *signals, *[ZERO] * sum(widths), *velocities]
        self.first_force = self.m
        first_signal = self.first_force + len(forces)
        self._first_of_node = first_signal + len(signals) + np.cumsum([0, *widths])
        self.first_drive = int(self._first_of_node[-1])
        self.first_acceleration = self.first_drive + self.drives
        self.inputs = self.first_acceleration + self.drives + 1
        self._first_of_kind = {
            "normal": 0,
            "signal": first_signal,
            "drive": self.first_drive,
            "one": self.inputs - 1,
        }

    def _place(self, key: Key) -> int:
        """Return where an input stands."""
        kind, number, which = key
        return int(self._first_of_node[number]) + which if kind == "node" else self._first_of_kind[kind] + number

    def _place_laws(self, book: Book) -> None:
        c = self.laws
        kinds = np.array([row.kind for row in book.rows], dtype=str)
        self.is_friction, self.is_tie, self.is_one_way, self.is_gap, self.is_stop = (
            kinds == kind for kind in ("friction", "tie", "one-way", "gap", "stop")
        )
        self.has_stops = bool(self.is_stop.any())
        self.restitution = np.array([row.restitution for row in book.rows])
        self.all_friction = bool(self.is_friction.all())
        self.mu_c, self.mu_s, self.least, self.dwell = c.mu_c, c.mu_s, c.least, c.dwell
        self.loaded = np.array([_ever_positive(s) for s in self.normals], dtype=bool) | self.pressed
        resists = (self.mu_s.max(axis=0, initial=0.0) > 0) | c.curved
        self.alive = (self.loaded & resists) | ~self.is_friction
        # rows that hold more or less backward than forward
        self.has_sides = (self.mu_s[0] != self.mu_s[1]) | (self.least[0] != self.least[1])
        self.has_sides |= self.is_one_way | self.is_stop
        self.hard = c.sticks & ~self.is_gap
        self.all_hard = bool((self.hard | self.is_gap).all())
        self.has_dead_bands = bool((self.hard & (c.rests_below > 0)).any())
        self.free = ~(c.sticks | c.has_slip_state)
        self.has_velocity_laws = bool((self.free | c.curved | c.has_slip_state).any())
        self.starts_slipping = np.array([row.slipping for row in book.rows], dtype=bool)
        # rise of the static coefficient with the dwell, forward and backward
        rise = np.maximum(self.mu_s - self.least, 0.0)
        self.rise = np.where(self.dwell > 0, rise, 0.0)
        # contacts that hold more at rest than in motion, forward and backward
        self.holds_more = (self.mu_s > self.least) & self.hard
        dwells = self.rise.max(axis=0, initial=0.0) > 0
        self.dwelling = (dwells & self.hard).nonzero()[0]
        # rows whose forces depend on how long they have been at rest
        self.aging = (dwells & ~self.free).nonzero()[0]
        self.inputs_and_dwells = self.inputs + self.dwelling.size
        self.dwell_place = np.full(self.m, -1)
        self.dwell_place[self.dwelling] = np.arange(self.dwelling.size)
        self.largest_coefficient = np.maximum(self.mu_s, self.least).max(axis=0, initial=0.0)

    def _join(self, book: Book) -> None:
        """Enter the coefficients of the rows."""
        n, rows, driven = self.n, Triplets(), Triplets()
        for j, row in enumerate(book.rows):
            for i, c in row.coefficients.items():
                (rows if i < n else driven).add(j, i if i < n else i - n, c)
        self.G, self.D = self.matrix(rows, (self.m, n)), self.matrix(driven, (self.m, self.drives))
        self.GT = self.G.T.tocsr() if self.sparse else np.ascontiguousarray(self.G.T)
        self.abs_G, self.abs_D, self.abs_GT = abs(self.G), abs(self.D), abs(self.GT)
        self.largest_lever = np.array([max(map(abs, row.coefficients.values())) for row in book.rows])

    def independent(self, coefficients: Any) -> Any:
        """Return coefficients on drives as those on independent drives: velocities of others are sums of theirs."""
        return coefficients if self.drives < 2 else coefficients @ self._sums

    @cached_property
    def _sums(self) -> Any:
        """The map from drives to independent drives; needed only where rows join two drives."""
        entries = Triplets()
        for k, factors in enumerate(made_of_others([drive.velocity for drive in self.scene.drives])):
            for i, factor in factors.items():
                entries.add(k, i, factor)
        return self.matrix(entries, (self.drives, self.drives))

    @cached_property
    def free_mobility(self) -> Array:
        """The relative acceleration of each row (m,) by a force of 1 N or N m along it, if no row is held.

        A body without inertia moves only with others: it counts as the lightest body that has one.
        """
        heavy = self.inertia > 0
        lightest = self.inertia.min(initial=math.inf, where=heavy)
        squared = self.G * self.G if isinstance(self.G, np.ndarray) else self.G.multiply(self.G)
        return np.maximum(squared @ (1.0 / np.where(heavy, self.inertia, lightest)), np.finfo(float).tiny)

    @cached_property
    def transmission(self) -> Transmission:
        """How fast bodies move with each other."""
        joined = [*(row.coefficients for row in self.rows), *(link.coefficients for link in self.couplings)]
        return Transmission(self.n, joined, self._followed())

    @cached_property
    def part_of_row(self) -> Indices:
        """The number of the part that each row belongs to (m,), which is the last one for rows between drives."""
        bodies = (next((i for i in row.coefficients if i < self.n), -1) for row in self.rows)
        return np.append(self.transmission.part, self.transmission.part.max(initial=-1) + 1)[list(bodies)]

    def _followed(self) -> list[tuple[int, int]]:
        """Return pairs of bodies: some force depends on the motion of the first and pushes the second."""
        pushes = [(form, {i}) for i, form in self.pushes]
        pushes += [(form, set(self.rows[j].coefficients)) for j, form in self._presses.items()]
        own = {i: [i] for i in range(self.n)} | {state: [i] for i, state in self.position_state.items()}
        own |= {state: list(self.rows[j].coefficients) for j, state in self.bristle_state.items()}
        return [
            (one, other)
            for form, pushed in pushes
            for one in self._read(form, own)
            for other in pushed
            if other < self.n and one != other
        ]

    def _read(self, form: Form, own: Mapping[int, Sequence[int]]) -> set[int]:
        """Return the bodies on which a form depends, directly or by functions and blocks; `own` are those of states."""
        found, seen, open_ones = set[int](), set[int](), [form]
        while open_ones:
            one = open_ones.pop()
            nodes = {number for kind, number, _ in one.inputs if kind == "node"}
            for node in (self.reader.nodes[k] for k in nodes):
                open_ones += node.arguments
                found.update(self.rows[node.row].coefficients if node.row >= 0 else ())
            for state in one.states:
                found.update(own.get(state, ()))
                if state not in seen:
                    seen.add(state)
                    open_ones += self._given_to.get(state, ())
        return {i for i in found if i < self.n}

    def _push(self, book: Book) -> None:
        """Enter what springs, dampers and loads push the bodies with, and the rates of blocks."""
        n, state, inputs = self.n, Triplets(), Triplets()
        for link in book.couplings:
            for i, c in link.coefficients.items():
                if i >= n:
                    continue
                for k, e in link.coefficients.items():
                    if link.stiffness:
                        state.add(i, self.position_state[k], -c * e * link.stiffness)
                    if k < n:
                        state.add(i, k, -c * e * link.damping)
                    else:
                        inputs.add(i, self.first_drive + k - n, -c * e * link.damping)
                inputs.add(i, self.inputs - 1, c * link.stiffness * link.rest)
        push_state, push_inputs = Triplets(), Triplets()
        for k, (i, _, _) in enumerate(book.forces):
            push_inputs.add(i, self.first_force + k, 1.0)
        for i, form in self.pushes:
            self._enter(form, i, push_state, push_inputs)
        self.push_C = self.matrix(push_state, (n, self.size))
        self.push_Q = self.matrix(push_inputs, (n, self.inputs))
        self.C = self.matrix(state, (n, self.size)) + self.push_C
        self.Q = self.matrix(inputs, (n, self.inputs)) + self.push_Q
        block_state, block_inputs = Triplets(), Triplets()
        for k, form in self._rates.items():
            self._enter(form, k - self.first_block, block_state, block_inputs)
        blocks = self.size - self.first_block
        self.block_C = self.matrix(block_state, (blocks, self.size))
        self.block_Q = self.matrix(block_inputs, (blocks, self.inputs))
        entries = state.values or push_state.values or block_state.values
        self.has_couplings = bool(entries or self.is_gap.any() or self.has_stops)
        self.abs_C, self.abs_Q, self.abs_push_Q = abs(self.C), abs(self.Q), abs(self.push_Q)
        self.has_pushes_by_state = bool(push_state.values or self.dependence is not None)

    @cached_property
    def coupling_forces(self) -> CouplingForces:
        """The forces of springs and dampers one by one."""
        n, count = self.n, len(self.couplings)
        levers, of_state, of_inputs = Triplets(), Triplets(), Triplets()
        for number, link in enumerate(self.couplings):
            for k, e in link.coefficients.items():
                if link.stiffness:
                    of_state.add(number, self.position_state[k], e * link.stiffness)
                if k < n:
                    of_state.add(number, k, e * link.damping)
                    levers.add(k, number, abs(e))
                else:
                    of_inputs.add(number, self.first_drive + k - n, e * link.damping)
            of_inputs.add(number, self.inputs - 1, -link.stiffness * link.rest)
        return CouplingForces(
            self.matrix(levers, (n, count)),
            self.matrix(of_state, (count, self.size)),
            self.matrix(of_inputs, (count, self.inputs)),
            np.array([len(link.coefficients) == 1 for link in self.couplings], dtype=bool),
        )

    def _piecewise(self, book: Book) -> PiecewiseMatrices:
        rows = {j: row for j, row in enumerate(book.rows) if row.regions}
        acts = Triplets()
        for k, row in enumerate(rows.values()):
            for i, c in row.coefficients.items():
                if i < self.n and row.kind == "gap":
                    acts.add(i, k, -c)
        regions = [(region, row.name) for row in rows.values() for region in row.regions]
        values = self._expressions([(region.value, name) for region, name in regions])
        borders = self._expressions([(border, name) for region, name in regions for border, _ in region.borders])
        return PiecewiseMatrices(rows, self.matrix(acts, (self.n, len(rows))), values, borders)

    def _expressions(self, found: Sequence[tuple[Array, str]]) -> tuple[Any, Any]:
        """Return expressions of the stretches of rows as rows of matrices, from states and from inputs."""
        states, inputs = Triplets(), Triplets()
        for k, (expression, row) in enumerate(found):
            stretch, rate, constant = expression.tolist()
            form = Form(inputs={("one", 0, 0): constant})
            form.add(self.reader.form(Stretch(row), row), stretch)
            form.add(self.reader.form(RelativeVelocity(row), row), rate)
            self._enter(form, k, states, inputs)
        count = len(found)
        return self.matrix(states, (count, self.size)), self.matrix(inputs, (count, self.inputs))

    def _enter(self, form: Form, row: int, states: Triplets, inputs: Triplets) -> None:
        """Enter a form as a row of two matrices."""
        for column, c in form.states.items():
            states.add(row, column, c)
        for key, c in form.inputs.items():
            inputs.add(row, self._place(key), c)

    def matrix(self, triplets: Triplets, shape: tuple[int, int]) -> Any:
        """Return entries as a matrix, dense or sparse as the scene is."""
        if not self.sparse:
            dense = np.zeros(shape)
            if triplets.rows:
                np.add.at(dense, (triplets.rows, triplets.columns), triplets.values)
            return dense
        entries = (np.array(triplets.values), (np.array(triplets.rows, int), np.array(triplets.columns, int)))
        matrix = scipy.sparse.coo_array(entries, shape=shape).tocsr()
        matrix.eliminate_zeros()
        return matrix

    def at_start(self) -> Array:
        """Return the state that the scene gives."""
        scene, y = self.scene, np.zeros(self.size)
        y[: self.n] = [body.velocity for body in scene.bodies]
        places: list[Any] = [*scene.bodies, *scene.drives]
        y[self.n : self.first_bristle] = [places[i].position for i in self.placed]
        for j, state in self.bristle_state.items():
            y[state] = self.rows[j].deflection
        for place in self.blocks.values():
            y[place.first : place.first_held] = place.block.states or ()
            if isinstance(place.block, Sampled) and place.block.held:
                y[place.first_held : place.end] = place.block.held
        return y

    def loads(self, start: float, stop: float, stepped: bool = False) -> Loads:
        """Return the inputs over a time span; normal forces that are mere loads are cut off at 0."""
        # a run with tables notes their regions in its loads: then these are not shared
        make = self._loads if self.dependence is None else self._made_loads
        found: Loads = make(start, stop, stepped)
        return found

    def _made_loads(self, start: float, stop: float, stepped: bool) -> Loads:
        clipped = [
            s if pressed else s.clipped(start, stop)
            for s, pressed in zip(self.normals, self.pressed.tolist(), strict=True)
        ]
        samples = [t for _, block, _ in self.sampled for t in block.instants(start, stop)]
        drives = range(self.first_drive, self.first_acceleration)
        return Loads([*clipped, *self.others], drives, start, stop, stepped, samples, self.generic)

    @property
    def has_coincidences(self) -> bool:
        """Whether the scene has coincidences that a `generic` system disregards."""
        ends = -np.inf, np.inf
        loads = (*self.normals, *self.others)
        return self.reader.is_shared or any(load.points(*ends) != load.breaks(*ends) for load in loads)

    def sample(self, t: float, start: float, q: Array, y: Array) -> Array:
        """Return the state after the blocks that are due at `t` have read their inputs from `q` and `y`.

        A ValueError names block, time and arguments where a block returns anything but finite numbers.
        """
        after = y
        for place, block, read in self.sampled:
            if not block.is_due(t, start):
                continue
            if after is y:
                after = y.copy()
            x, u = y[place.first : place.first_held], read.at(y, q)
            try:
                held = block.call("output", t, x, u, place.outputs, exactly=False)
                after[place.first_held : place.end] = held
                if block.update is not None:
                    after[place.first : place.first_held] = block.call("update", t, x, u, place.states, True)
            except ValueError as error:
                given = ", ".join(f"{value:.9g}" for value in u.tolist())
                raise ValueError(f"{block.label}: {error} at t = {t:.9g} s with the inputs ({given})") from error
        return after

    def observed_values(
        self, q: Array, y: Array, majorants: tuple[Array, Array], t: Array, taus: Array, friction: Friction
    ) -> tuple[Array, Array]:
        """Return the observed quantities at many times, a line each, and their majorants.

        `majorants` are those of the inputs and of the states, columns or one column for all times.
        """
        self._only_observed.fill(q, y, t, taus, friction)
        largest = np.maximum(np.abs(q), majorants[0])
        of_inputs = self._only_observed.enter_majorants(largest, majorants[1], q, y)
        return self._observed.at(y, q), self._observed.majorants(majorants[1], of_inputs)

    def outputs_of(self, place: BlockPlace, t: Array, y: Array, q: Array) -> Array:
        """Return the outputs of a block that is not sampled, a line each, at many times."""
        block, reader = place.block, self.reader
        if isinstance(block, StateSpace):
            forms = [reader.linear_output(block, k, block.label) for k in range(place.outputs)]
            found = Forms.of(forms, self._place).at(y, q)
            limits = block.limits or ((-np.inf, np.inf),) * place.outputs
            return np.asarray(np.clip(found, *np.array(limits).T[:, :, None]))
        assert isinstance(block, Block)
        x = y[place.first : place.first_held]
        if block.output is None:
            return x
        u = self.inputs_of(place, y, q)
        columns = [
            block.call("output", float(t[k]), x[:, k], u[:, k], place.outputs, exactly=False) for k in range(t.size)
        ]
        return np.array(columns).reshape(t.size, place.outputs).T

    def inputs_of(self, place: BlockPlace, y: Array, q: Array) -> Array:
        """Return the inputs of a block from states and inputs of the system, a line each."""
        block = place.block
        return Forms.of([self.reader.form(u, block.label) for u in block.quantities()], self._place).at(y, q)

    def drive_velocities(self, q: Array) -> Array:
        """Return the velocities of the drives from the inputs."""
        return q[self.first_drive : self.first_acceleration]

    def lead_drives(self, entries: Indices) -> bool:
        """Tell whether any of some inputs is the velocity of a drive."""
        return bool(((entries >= self.first_drive) & (entries < self.first_acceleration)).any())

    def drive_accelerations(self, q: Array) -> Array:
        """Return the accelerations of the drives from the inputs."""
        return q[self.first_acceleration : self.inputs - 1]

    def accelerations_of_drives(self, segment: Segment) -> tuple[Array, Array]:
        """Return the patterns of the accelerations of drives in a segment, a column each, and their roughness."""
        return self.drive_accelerations(segment.patterns.T), self.drive_accelerations(segment.roughness)

    def relative_velocity(self, y: Array, q: Array) -> Array:
        """Return ``w`` of every row from states and inputs."""
        return self.relative(y[: self.n], self.drive_velocities(q))

    def relative(self, v: Array, u: Array) -> Array:
        """Return ``G v + D u`` from velocities of bodies and drives, or from accelerations."""
        w = self.G @ v
        return np.asarray(w + self.D @ u if self.drives else w)

    def sign_of(self, w: Array) -> Array:
        """Return the mode that a law without modes shows: the sign of `w` beyond its pre-slip velocity."""
        return np.where(np.abs(w) > like(self.laws.slips_beyond, w), np.sign(w), 0.0)

    def decays(self, order: int) -> Array:
        """Return the sizes of the Taylor coefficients of ``exp(-t / dwell)`` of rows with a dwell, a line per order."""
        k = np.arange(order + 1)[:, None]
        return np.asarray(self.dwell[self.dwelling] ** -k / np.cumprod(np.maximum(k, 1), axis=0))

    def _made(self, make: Callable[[System, bytes], Any], key: bytes) -> Any:
        return make(self, key)

    def balance(self, held: Mask) -> Balance:
        """Return the balance of forces with some rows held; the latest are remembered."""
        return self._balances(held.tobytes())

    def is_torn_with(self, held: Mask, row: int) -> bool:
        """Tell whether drives tear rows that are held once another one is held, too; without it they do not."""
        if not self.sparse:
            held = held.copy()
            held[row] = True
            return self.balance(held).parting is not None
        # only what the row joins can be torn with it
        rows, number, of_body = self._joined(held.tobytes())
        bodies = self.G.indices[self.G.indptr[row] : self.G.indptr[row + 1]]
        own = np.isin(number, of_body[bodies])
        return self._components.are_torn(np.union1d(rows[own], row).astype(np.intp))

    def _numbered(self, held: bytes) -> tuple[Indices, Indices, Indices]:
        """Return held rows, and the numbers of the components of these and of all bodies."""
        rows = np.frombuffer(held, dtype=bool).nonzero()[0]
        return rows, *components_of(self.G[rows])

    def with_held(self, y: Array, u: Array, held: Mask) -> Array:
        """Return a state in which some rows are held, momentum conserved, while drives have the velocities `u`."""
        if not np.count_nonzero(held):
            return y
        y = y.copy()
        y[: self.n] = self.balance(held).project(y[: self.n], u)
        return y

    def _balance(self, held: bytes) -> Balance:
        rows = np.frombuffer(held, dtype=bool).nonzero()[0]
        G, D = self.G[rows], self.D[rows]
        return Balance(self.inertia, G, D, lambda some: self._components.component(rows[some]), self.independent)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the scene only: all the rest follows from it."""
        return System, (self.scene, self.observed, self.generic)


def _parts(load: Load) -> tuple[Signal, Expression | None]:
    """Return a load as a signal and what depends on the state."""
    if isinstance(load, Signal):
        return load, None
    own = as_expression(load)
    return own.signal, Expression(own.terms) if own.terms else None


def _ever_positive(signal: Signal) -> bool:
    match signal:
        case Constant(value=value):
            return value > 0
        case PiecewiseLinear(values=values):
            return max(values) > 0
    return True
