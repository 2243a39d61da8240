"""What of the inputs depends on the state: expressions of quantities, resolved to linear forms and functions.

``q = loads(t) + S y + P q + f``: `S` and `P` are constant, and `f` are the values of functions (`feedback`), each an
entry of `q` of its own. Linear forces need no entry: they are part of the matrices of the system.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Protocol, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.model import quantities as of
from stickslip.model.elements import AnyBlock, Block, Sampled, StateSpace
from stickslip.model.elements.book import Book
from stickslip.model.quantities import Expression, Quantity
from stickslip.model.signals import Constant, Load, Signal

__all__ = ["BlockPlace", "Dependence", "Form", "Friction", "Node", "Part", "Reader"]

_Found = TypeVar("_Found")
Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Key = tuple[str, int, int]
"""Kind of an input, its number, and for functions which of their values."""

Regions = tuple[int, ...] | None
"""The region of each table in which a motion is; None where tables are looked up."""

_STEP, _SMALL = 1e-7, 1e-3
"""Differences are this part of an argument, or of a small number."""

_KEPT = 16
"""Values of a function that are remembered: the solver and its guards ask for the same ones."""


class Friction(Protocol):
    """What tells the friction force of a moving row."""

    def friction_of(self, row: int, w: float, normal: float, tau: float, y: Array) -> float:
        """Return the force of one row at local time `tau`, 0 where it is held."""
        ...


@dataclass
class Form:
    """A linear form of states and inputs."""

    states: dict[int, float] = field(default_factory=dict)
    inputs: dict[Key, float] = field(default_factory=dict)

    def add(self, other: Form, factor: float = 1.0) -> None:
        """Add a multiple of another form."""
        for i, c in other.states.items():
            self.states[i] = self.states.get(i, 0.0) + factor * c
        for key, c in other.inputs.items():
            self.inputs[key] = self.inputs.get(key, 0.0) + factor * c


@dataclass(frozen=True)
class BlockPlace:
    """Where a block stands in the state: `states` of them from `first` on, `outputs` held ones from `first_held` on."""

    block: AnyBlock
    first: int
    states: int
    first_held: int
    outputs: int

    @property
    def end(self) -> int:
        """The place after the last one."""
        return self.first_held + (self.outputs if isinstance(self.block, Sampled) else 0)


@dataclass
class Node:
    """A function among the inputs.

    Attributes
    ----------
    label : str
        How messages name it.
    arguments : list of Form
    values : callable
        ``values(t, arguments)`` returns `width` numbers.
    given : callable or None
        ``given(t, arguments)`` returns their derivatives, a line each; None where differences are taken.
    row : int
        The row whose heat it is, -1 for a function.
    width : int
        How many values it has.
    timed : bool
        Whether it depends on time beside its arguments.
    table : Table or None
        Straight lines, each of which holds in a region of the one argument.
    calls : int
        How often the function has been called.
    """

    label: str
    arguments: list[Form]
    values: Callable[[float, Array], Array]
    given: Callable[[float, Array], Array] | None = None
    row: int = -1
    width: int = 1
    timed: bool = False
    table: of.Table | None = None
    calls: int = 0
    known: dict[tuple[float, ...], Array] = field(default_factory=dict)

    def at(self, t: float, arguments: Array) -> Array:
        """Return the values; a ValueError names element, time and arguments where they are no finite numbers."""
        key = (t if self.timed else 0.0, *arguments.tolist())
        found = self.known.get(key)
        if found is not None:
            return found
        self.calls += 1
        try:
            found = self.values(t, arguments)
        except ValueError as error:
            given = ", ".join(f"{x:.9g}" for x in arguments.tolist())
            raise ValueError(f"{self.label} {error} at t = {t:.9g} s with the arguments ({given})") from error
        if len(self.known) >= _KEPT:
            self.known.pop(next(iter(self.known)), None)
        self.known[key] = found
        return found

    def slopes(self, t: float, arguments: Array) -> Array:
        """Return the derivatives of the values, a line each."""
        if self.given is not None:
            return self.given(t, arguments)
        return _differences(lambda x: self.at(t, x), arguments, self.at(t, arguments))


def _differences(function: Callable[[Array], Array], arguments: Array, value: Array) -> Array:
    """Return the derivatives of a function by forward differences, a line per value."""
    found = np.empty((value.size, arguments.size))
    for k, x in enumerate(arguments.tolist()):
        moved = arguments.copy()
        moved[k] += _STEP * max(abs(x), _SMALL)
        found[:, k] = (function(moved) - value) / (moved[k] - x)
    return found


class Reader:
    """Resolves quantities to linear forms.

    Parameters
    ----------
    book : Book
    position_state : dict of int to int
        Where the positions of bodies and drives stand in the state.
    places : dict of str to BlockPlace
        Where the states of blocks stand.

    Attributes
    ----------
    signals : list of Signal
        Loads that are inputs of their own.
    nodes : list of Node
        Functions, each after those that it depends on.
    """

    def __init__(self, book: Book, position_state: dict[int, int], places: dict[str, BlockPlace]) -> None:
        self._book, self._position_state, self._places = book, position_state, places
        self._functions: dict[str, int] = {}
        self._row_of = book.row_index
        self._resolving: list[tuple[Quantity, str]] = []
        self._known: dict[Quantity, Form] = {}
        self.signals: list[Signal] = []
        self.nodes: list[Node] = []

    def form(self, load: Load, label: str) -> Form:
        """Return a quantity or a signal as a linear form; `label` is the element that reads it."""
        if isinstance(load, Signal):
            return self._of_signal(load)
        if isinstance(load, Expression):
            found = self._of_signal(load.signal)
            for atom, factor in load.terms:
                found.add(self.form(atom, label), factor)
            return found
        assert isinstance(load, Quantity)
        known = self._known.get(load)
        if known is None:
            known = self._known[load] = self._resolved(load, label)
        return known

    def _resolved(self, atom: Quantity, label: str) -> Form:
        book = self._book
        match atom:
            case of.Velocity(body=body):
                return self._velocity(book.index[body])
            case of.Position(body=body):
                return self._position(book.index[body])
            case of.RelativeVelocity(row=row):
                return self._along(row, self._velocity)
            case of.Stretch(row=row):
                return self._along(row, self._position)
            case of.Normal(row=row):
                return self._normal(atom, row)
            case of.Power(row=row):
                return self._power(atom, row)
            case of.Output(block=block, index=index):
                return self._output(atom, block, index)
            case of.Feedback():
                arguments = [self.form(argument, label) for argument in atom.arguments]
                return self._node(
                    Node(
                        f"{label}: {atom.label}",
                        arguments,
                        lambda t, x: np.array([atom.value(x.tolist())]),
                        None if atom.derivatives is None else lambda t, x: atom.slopes(x.tolist())[None, :],
                    )
                )
            case of.Table():
                return self._lookup(self.form(atom.quantity, label), atom, label)
        raise TypeError(f"{label}: unknown quantity {atom!r}")

    def _lookup(self, form: Form, atom: of.Table, label: str) -> Form:
        return self._node(Node(label, [form], _never, table=atom))

    def _output(self, atom: Quantity, name: str, index: int) -> Form:
        place = self._places[name]
        block = place.block
        match block:
            case Sampled():
                return Form({place.first_held + index: 1.0})
            case StateSpace():
                label = f"output {index} of {block.label}"
                found = self._inside(atom, label, lambda: self.linear_output(block, index, label))
                return self._limited(found, block, index, label)
            case Block(output=None):
                return Form({place.first + index: 1.0})
        assert isinstance(block, Block)
        if name not in self._functions:
            label = f"the output of {block.label}"
            reads = block.feeds_through
            arguments = self._inside(atom, label, lambda: self.of_block(block, label, reads))
            states, width = len(block.states), place.outputs
            unread = np.full(len(block.inputs), np.nan)

            def values(t: float, x: Array) -> Array:
                u = x[states:] if reads else unread
                return block.call("output", t, x[:states], u, width, exactly=False)

            node = Node(f"{block.label}:", arguments, values, width=width, timed=True)
            ((_, self._functions[name], _),) = self._node(node).inputs
        return Form(inputs={("node", self._functions[name], index): 1.0})

    def of_block(self, block: AnyBlock, label: str, inputs: bool = True) -> list[Form]:
        """Return the states of a block, and its inputs where these are wanted."""
        place = self._places[block.name]
        states = [Form({place.first + k: 1.0}) for k in range(place.states)]
        return states + [self.form(u, label) for u in block.inputs if inputs]

    def linear_output(self, block: StateSpace, index: int, label: str) -> Form:
        """Return ``C x + D u`` of one output of a linear block, before it is limited."""
        first = self._places[block.name].first
        found = Form({first + k: c for k, c in enumerate(block.C[index]) if c})
        for u, c in zip(block.inputs, block.D[index], strict=True):
            if c:
                found.add(self.form(u, label), c)
        return found

    def _limited(self, form: Form, block: StateSpace, index: int, label: str) -> Form:
        low, high = block.limits[index] if block.limits is not None else (-math.inf, math.inf)
        limits = of.saturate(of.TIME, low, high)
        return self._lookup(form, limits, label) if isinstance(limits, of.Table) else form

    def rates(self, block: AnyBlock) -> list[Form]:
        """Return how fast the states of a block change."""
        place, label = self._places[block.name], f"{block.label}: an input"
        # all inputs, whether something reads them or not: results do
        inputs = [self.form(u, label) for u in block.inputs]
        if isinstance(block, StateSpace):
            found = [Form({place.first + k: c for k, c in enumerate(row) if c}) for row in block.A]
            for form, row in zip(found, block.B, strict=True):
                for u, c in zip(inputs, row, strict=True):
                    form.add(u, c)
            return found
        if isinstance(block, Sampled) or not place.states:
            return [Form() for _ in range(place.states)]
        assert isinstance(block, Block)
        count = place.states

        def values(t: float, x: Array) -> Array:
            return block.call("derivative", t, x[:count], x[count:], count, exactly=True)

        node = Node(f"{block.label}:", self.of_block(block, label), values, width=count, timed=True)
        ((_, number, _),) = self._node(node).inputs
        return [Form(inputs={("node", number, k): 1.0}) for k in range(count)]

    def _velocity(self, i: int) -> Form:
        book = self._book
        n, drives = len(book.bodies), len(book.drives)
        if i < n:
            return Form({i: 1.0})
        return Form(inputs={("drive", i - n, 0): 1.0}) if i < n + drives else Form()

    def _position(self, i: int) -> Form:
        state = self._position_state.get(i)
        return Form() if state is None else Form({state: 1.0})

    def _along(self, row: str, of_body: Callable[[int], Form]) -> Form:
        found = Form()
        for i, c in self._book.rows[self._row_of[row]].coefficients.items():
            found.add(of_body(i), c)
        return found

    def _of_signal(self, signal: Signal) -> Form:
        if isinstance(signal, Constant):
            return Form(inputs={("one", 0, 0): signal.value}) if signal.value else Form()
        if signal not in self.signals:
            self.signals.append(signal)
        return Form(inputs={("signal", self.signals.index(signal), 0): 1.0})

    def _normal(self, atom: Quantity, row: str) -> Form:
        j = self._row_of[row]
        load = self._book.rows[j].normal
        if isinstance(load, Signal):
            return Form(inputs={("normal", j, 0): 1.0})
        label = f"the normal force of contact {row!r}"
        own = self._inside(atom, label, lambda: self.form(load, label))
        return self._lookup(own, of.Table(of.TIME, (0.0,), (0.0,), 0.0, 1.0), label)

    def _power(self, atom: Quantity, row: str) -> Form:
        label = f"the power of contact {row!r}"
        normal = self._inside(atom, label, lambda: self.form(of.Normal(row), label))
        w = self._along(row, self._velocity)
        return self._node(Node(label, [w, normal], _never, row=self._row_of[row]))

    def _inside(self, atom: Quantity, label: str, resolve: Callable[[], _Found]) -> _Found:
        """Resolve what a quantity depends on; where that is the quantity itself, refuse."""
        open_ones = [known for known, _ in self._resolving]
        if atom in open_ones:
            loop = [text for _, text in self._resolving[open_ones.index(atom) :]]
            raise ValueError(
                f"{loop[0]} depends on itself without a state between (an algebraic loop): "
                f"{' <- '.join([*loop, loop[0]])}; put a block with a state into the loop"
            )
        self._resolving.append((atom, label))
        try:
            return resolve()
        finally:
            self._resolving.pop()

    def _node(self, node: Node) -> Form:
        self.nodes.append(node)
        return Form(inputs={("node", len(self.nodes) - 1, 0): 1.0})


def _never(t: float, x: Array) -> Array:
    raise AssertionError("powers and tables are not called as functions")


@dataclass
class Part:
    """Linear forms as small arrays: ``S y[columns] + P q[places]``."""

    columns: Indices
    S: Array
    places: Indices
    P: Array

    @classmethod
    def of(cls, forms: Sequence[Form], place: Callable[[Key], int]) -> Part:
        """Return forms as arrays; `place` tells where an input stands."""
        columns = sorted({i for form in forms for i in form.states})
        places = sorted({place(key) for form in forms for key in form.inputs})
        S, P = np.zeros((len(forms), len(columns))), np.zeros((len(forms), len(places)))
        for k, form in enumerate(forms):
            for i, c in form.states.items():
                S[k, columns.index(i)] += c
            for key, c in form.inputs.items():
                P[k, places.index(place(key))] += c
        return cls(np.array(columns, dtype=np.intp), S, np.array(places, dtype=np.intp), P)

    def at(self, y: Array, q: Array) -> Array:
        """Return the values of the forms, columns where `y` and `q` have columns."""
        return self.S @ y[self.columns] + self.P @ q[self.places]

    def sizes(self, y: Array, q: Array) -> Array:
        """Return what adds up in them, from absolute values."""
        return np.abs(self.S) @ y[self.columns] + np.abs(self.P) @ q[self.places]

    def slopes(self, columns: Indices, q_by_y: Array) -> Array:
        """Return the derivatives with respect to some states, from those of the inputs."""
        found = self.P @ q_by_y[self.places]
        found[:, np.searchsorted(columns, self.columns)] += self.S
        return found


class Dependence:
    """The inputs that depend on the state.

    Parameters
    ----------
    nodes : sequence of Node
    first : int
        Place of the first node's first value among the inputs.
    normals : dict of int to Form
        Normal forces that depend on the state, by row: what is added to their signals.
    place : callable
        The place of an input by its key.
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        first: int,
        normals: dict[int, Form],
        place: Callable[[Key], int],
    ) -> None:
        self.nodes = list(nodes)
        self._parts = [Part.of(node.arguments, place) for node in nodes]
        starts = first + np.cumsum([0, *(node.width for node in nodes)])
        self._ranges = [slice(a, b) for a, b in pairwise(starts.tolist())]
        self.rows = np.array(sorted(normals), dtype=np.intp)
        self._normals = Part.of([normals[j] for j in sorted(normals)], place)
        parts = [*self._parts, self._normals]
        self.columns = np.unique(np.concatenate([part.columns for part in parts]))
        self.tables = [k for k, node in enumerate(nodes) if node.table is not None]
        self._lines = {k: np.array(self.nodes[k].table.lines) for k in self.tables}  # type: ignore[union-attr]
        self._corners = {k: np.array(self.nodes[k].table.xs) for k in self.tables}  # type: ignore[union-attr]
        self.is_linear = len(self.tables) == len(self.nodes)
        self.places = np.concatenate([np.arange(first, int(starts[-1])), self.rows]).astype(np.intp)
        self.for_tables = self.before(place for k in self.tables for place in self._parts[k].places.tolist())
        """The nodes on which it depends what tables are looked up at."""
        read = [self._parts[k].places for k in {*self.tables, *self.for_tables}]
        self.read_for_tables = frozenset(place for places in read for place in places.tolist())
        """The places of the inputs on which that depends."""
        self.for_normals = self.before(self._normals.places.tolist())
        """Those on which normal forces depend."""

    def before(self, places: Iterable[int]) -> frozenset[int]:
        """Return the nodes on which inputs depend, at once or by way of others."""
        found, open_ones = set(), set(places)
        for number in reversed(range(len(self.nodes))):
            own = self._ranges[number]
            if not open_ones.isdisjoint(range(own.start, own.stop)):
                found.add(number)
                open_ones.update(self._parts[number].places.tolist())
        return frozenset(found)

    @property
    def places_read(self) -> list[int]:
        """The places of the inputs that nodes read."""
        return [place for part in self._parts for place in part.places.tolist()]

    @property
    def calls(self) -> int:
        """How often functions have been called."""
        return sum(node.calls for node in self.nodes)

    def is_linear_in(self, regions: Regions) -> bool:
        """Tell whether all is linear while tables follow the lines of some regions."""
        return self.is_linear and (regions is not None or not self.tables)

    def looked_up(self, q: Array, y: Array) -> Array:
        """Return what each table is looked up at, a line each; the inputs are filled."""
        found = [self._parts[k].at(y, q)[0] for k in self.tables]
        return np.array(found).reshape(len(found), *y.shape[1:])

    def argument(self, number: int) -> Part:
        """Return what a node is a function of, a table what it is looked up at."""
        return self._parts[number]

    def region(self, number: int, x: float) -> int:
        """Return the region of a table in which `x` lies."""
        return int(np.searchsorted(self._corners[self.tables[number]], x, side="right"))

    def borders(self, number: int, region: int) -> tuple[float, float]:
        """Return between which values a region of a table lies."""
        corners = self._corners[self.tables[number]]
        low = float(corners[region - 1]) if region > 0 else -math.inf
        return low, float(corners[region]) if region < corners.size else math.inf

    def _line(self, k: int, x: Array, regions: Regions) -> Array:
        """Return offset and slope of a table, a line per value where its region is not given."""
        if regions is not None:
            return np.asarray(self._lines[k][regions[self.tables.index(k)]])
        return np.asarray(self._lines[k][np.searchsorted(self._corners[k], x, side="right")].T)

    def steepest(self, inputs: int, size: int) -> Any:
        """Return how strongly states can change inputs at most by tables and sums, as a sparse matrix of sizes."""
        rows: dict[int, dict[int, float]] = {}

        def enter(place: int, part: Part, line: int, slope: float) -> None:
            found = rows.setdefault(place, {})
            for column, c in zip(part.columns.tolist(), np.abs(part.S[line]).tolist(), strict=True):
                found[column] = found.get(column, 0.0) + slope * c
            for other, c in zip(part.places.tolist(), np.abs(part.P[line]).tolist(), strict=True):
                for column, of_other in rows.get(other, {}).items():
                    found[column] = found.get(column, 0.0) + slope * c * of_other

        for k in self.tables:
            enter(self._ranges[k].start, self._parts[k], 0, float(np.abs(self._lines[k][:, 1]).max()))
        for line, row in enumerate(self.rows.tolist()):
            enter(row, self._normals, line, 1.0)
        entries = [(place, column, c) for place, row in rows.items() for column, c in row.items()]
        places, columns, values = zip(*entries, strict=True) if entries else ((), (), ())
        return scipy.sparse.csr_array((values, (places, columns)), shape=(inputs, size))

    def pattern(self, inputs: int) -> Array:
        """Return numbers in place of the derivatives, none of which cancel: where these may differ from 0."""
        found = np.zeros((inputs, self.columns.size))
        found[self.places] = np.random.default_rng(0).uniform(1.0, 2.0, (self.places.size, self.columns.size))
        return found

    def forget(self) -> None:
        """Forget the values of functions: they may not be the same in another run."""
        for node in self.nodes:
            node.known.clear()

    def fill(
        self,
        q: Array,
        y: Array,
        t: Any,
        tau: Any,
        friction: Friction | None,
        wanted: Collection[int] | None = None,
        regions: Regions = None,
    ) -> None:
        """Enter what depends on the state into the inputs, in place; columns where there are many times.

        Parameters
        ----------
        q : array (inputs,) or (inputs, k)
        y : array (size,) or (size, k)
        t, tau : float or array (k,)
            Time, and local time of the motion, in s.
        friction : Friction or None
            The motion that tells friction forces; None where its modes are not known yet.
        wanted : collection of int or None
            The nodes that are wanted: functions may be slow. None for all of them.
        regions : tuple of int or None
            Whose line each table follows, also beyond its borders; None for what it is looked up at.
        """
        for number, (node, part, own) in enumerate(zip(self.nodes, self._parts, self._ranges, strict=True)):
            if wanted is not None and number not in wanted:
                continue
            arguments = part.at(y, q)
            if node.table is not None:
                offset, slope = self._line(number, arguments[0], regions)
                q[own] = offset + slope * arguments[0]
                continue
            if q.ndim == 1:
                q[own] = _value(node, t, arguments, tau, y, friction)
                continue
            for k in range(q.shape[1]):
                q[own, k] = _value(node, float(t[k]), arguments[:, k], float(tau[k]), y[:, k], friction)
        if self.rows.size:
            q[self.rows] += self._normals.at(y, q)

    def add_linear(self, q: Array, y: Array, regions: Regions) -> None:
        """Enter what depends linearly on the state, in place; columns where `q` and `y` have columns.

        These may be values, rates, Taylor coefficients or maps: the last input is the constant 1, which offsets of
        tables are multiples of.
        """
        for k in self.tables:
            x = self._parts[k].at(y, q)[0]
            offset, slope = self._line(k, x, regions)
            q[self._ranges[k]] = slope * x + offset * q[-1]
        if self.rows.size:
            q[self.rows] += self._normals.at(y, q)

    def add_sizes(self, q: Array, y: Array, slopes: Array | None, values: bool) -> None:
        """Add what adds up in the inputs, in place; `slopes` are those of the functions."""
        if slopes is not None:
            for own in self._ranges:
                q[own] += np.abs(slopes[own]) @ y[self.columns]
        else:
            for k in self.tables:
                offset, slope = np.abs(self._lines[k]).max(axis=0)
                q[self._ranges[k]] += slope * self._parts[k].sizes(y, q) + (offset if values else 0.0)
        if self.rows.size:
            q[self.rows] += self._normals.sizes(y, q)

    def slopes(
        self, q: Array, y: Array, t: float, tau: float, friction: Friction, regions: Regions = None
    ) -> Array:
        """Return the derivatives of the inputs with respect to the states `columns`."""
        found = np.zeros((q.size, self.columns.size))
        for number, (node, part, own) in enumerate(zip(self.nodes, self._parts, self._ranges, strict=True)):
            arguments = part.at(y, q)
            if node.table is not None:
                by_arguments = np.array([[self._line(number, arguments[0], regions)[1]]])
            elif node.row < 0:
                by_arguments = node.slopes(t, arguments)
            else:

                def heat(x: Array, node: Node = node) -> Array:
                    return np.array([_power(node, x, tau, y, friction)])

                by_arguments = _differences(heat, arguments, q[own])
            found[own] = by_arguments @ part.slopes(self.columns, found)
        if self.rows.size:
            found[self.rows] += self._normals.slopes(self.columns, found)
        return found


def _value(node: Node, t: float, x: Array, tau: float, y: Array, friction: Friction | None) -> Any:
    return node.at(t, x) if node.row < 0 else _power(node, x, tau, y, friction)


def _power(node: Node, x: Array, tau: float, y: Array, friction: Friction | None) -> float:
    w, normal = x.tolist()
    if friction is None or not w:
        return 0.0
    return float(w) * friction.friction_of(node.row, w, max(normal, 0.0), tau, y)
