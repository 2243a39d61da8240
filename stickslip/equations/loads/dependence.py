"""The inputs that depend on the state, evaluated: values, slopes, Taylor coefficients and majorants."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import scipy

from stickslip.equations.algebra.floats import Columns
from stickslip.equations.algebra.matrices import dense
from stickslip.equations.loads.loads import TableRegions
from stickslip.equations.loads.reader import Form, Key, Node, differences
from stickslip.model.arrays import Array, Indices

_CANCELLED = 1e-14  # part of its majorant below which a sum is roundoff
_DENSE = 1000  # entries up to which the matrix of some forms is dense
_KEPT = 16  # values of a function that are remembered: the solver and its guards ask for the same ones

# The friction force of a row, 0 where it is held, from its number, its relative velocity and normal force, the local
# time, and the deflection of its bristles if it has some.
Friction = Callable[[int, float, float, float, Sequence[float]], float]


@dataclass(frozen=True)
class Forms:
    """Linear forms as small arrays: ``S y[states] + P q[places]``; the matrices of many forms are sparse."""

    states: Indices
    S: Any
    places: Indices
    P: Any

    @classmethod
    def of(cls, forms: Sequence[Form], place: Callable[[Key], int]) -> Forms:
        """Return forms as arrays; `place` tells where an input stands."""
        of_states = [dict(form.states) for form in forms]
        of_inputs: list[dict[int, float]] = [{} for _ in forms]
        for own, form in zip(of_inputs, forms, strict=True):
            for key, c in form.inputs.items():
                own[place(key)] = own.get(place(key), 0.0) + c
        return cls(*_compressed(of_states), *_compressed(of_inputs))

    def at(self, y: Array, q: Array) -> Array:
        """Return the values of the forms, columns where `y` and `q` have columns."""
        return np.asarray(self.S @ y[self.states] + self.P @ q[self.places])

    def majorants(self, y: Array, q: Array) -> Array:
        """Return the majorants of the forms."""
        S, P = self._abs
        return np.asarray(S @ np.abs(y[self.states]) + P @ np.abs(q[self.places]))

    @cached_property
    def _abs(self) -> tuple[Any, Any]:
        return abs(self.S), abs(self.P)

    def slopes(self, states: Indices, q_by_y: Array) -> Array:
        """Return the derivatives with respect to some states, from those of the inputs."""
        found: Array = self.P @ q_by_y[self.places]
        found[:, np.searchsorted(states, self.states)] += dense(self.S)
        return found


def _compressed(lines: Sequence[Mapping[int, float]]) -> tuple[Indices, Any]:
    """Return the columns that occur in lines of coefficients, and the matrix of these columns."""
    columns = sorted({column for line in lines for column in line})
    number = {column: k for k, column in enumerate(columns)}
    shape = len(lines), len(columns)
    entries = [(k, number[column], c) for k, line in enumerate(lines) for column, c in line.items()]
    rows, at, values = (list(one) for one in zip(*entries, strict=True)) if entries else ([], [], [])
    if shape[0] * shape[1] > _DENSE:
        return np.array(columns, dtype=np.intp), scipy.sparse.csr_array((values, (rows, at)), shape=shape)
    matrix = np.zeros(shape)
    matrix[rows, at] = values
    return np.array(columns, dtype=np.intp), matrix


def _line_of(columns: Indices, matrix: Any, line: int) -> list[tuple[int, float]]:
    """Return the columns of a line that are not 0, each with the size of its coefficient."""
    _, at, values = scipy.sparse.find(matrix[[line]])
    return list(zip(columns[at].tolist(), np.abs(values).tolist(), strict=True))


@dataclass(frozen=True)
class Layer:
    """Nodes that read none of each other: the numbers of functions among all nodes, and of tables among all tables.

    `nodes` are the numbers of the tables among all nodes, `forms` their arguments, and `places` their inputs.
    """

    functions: list[int]
    nodes: frozenset[int]
    tables: Indices
    forms: Forms
    places: Indices


class Dependence:
    """The inputs that depend on the state.

    The first value of the first node is input `first`; `normals` are forms that are added to normal forces, by row.

    Attributes
    ----------
    arguments : list of Forms
        The arguments of each node; a table has one, at which it is looked up.
    tables : list of int
        The nodes that are tables.
    looked_up_forms : Forms
        The arguments of all tables.
    places, rows : array of int
        The inputs that depend on the state, and the rows among them: those whose normal forces do.
    states : array of int
        The states on which these inputs depend.
    width : int
        How many inputs are values of functions.
    has_heat : bool
        Whether a node is the power of a contact.
    calls : int
        How often functions have been called since they were last forgotten.
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        first: int,
        normals: dict[int, Form],
        place: Callable[[Key], int],
    ) -> None:
        self.nodes = list(nodes)
        self.calls, self._known = 0, [dict[tuple[float, ...], Sequence[float]]() for _ in nodes]
        self.arguments = [Forms.of(node.arguments, place) for node in nodes]
        starts = first + np.cumsum([0, *(node.width for node in nodes)])
        self._ranges = [slice(a, b) for a, b in pairwise(starts.tolist())]
        self.rows = np.array(sorted(normals), dtype=np.intp)
        self._normals = Forms.of([normals[j] for j in sorted(normals)], place)
        parts = [*self.arguments, self._normals]
        self.states = np.unique(np.concatenate([forms.states for forms in parts]))
        tables = {k: node.table for k, node in enumerate(nodes) if node.table is not None}
        self.tables = list(tables)
        self._table_of = {k: number for number, k in enumerate(self.tables)}
        self._lines = [np.array(table.lines) for table in tables.values()]
        self._corners = [np.array(table.xs) for table in tables.values()]
        self._steepest = np.array([np.abs(lines).max(axis=0) for lines in self._lines]).reshape(-1, 2).T
        self._layers = self._in_layers(place)
        self.looked_up_forms = Forms.of([nodes[k].arguments[0] for k in self.tables], place)
        self._last: tuple[TableRegions, Array] = None, np.empty((4, 0))
        self._for_table = [self.before(self.arguments[k].places.tolist()) for k in self.tables]
        self.is_linear = len(self.tables) == len(self.nodes)
        self.width = sum(node.width for node in nodes if node.table is None)
        self.has_heat = any(node.row >= 0 for node in nodes)
        self.places = np.concatenate([np.arange(first, int(starts[-1])), self.rows]).astype(np.intp)
        self.for_tables = self.before(place for k in self.tables for place in self.arguments[k].places.tolist())
        """The nodes on which the arguments of tables depend."""
        read = [self.arguments[k].places for k in {*self.tables, *self.for_tables}]
        self.read_for_tables = frozenset(place for places in read for place in places.tolist())
        """The places of the inputs on which these arguments depend."""
        self.for_normals = self.before(self._normals.places.tolist())
        """The nodes on which normal forces depend."""
        self.but_rates = frozenset(k for k, node in enumerate(self.nodes) if not node.is_rate)
        """All nodes but those that only give rates of states of blocks: a result does not show such rates."""

    def _in_layers(self, place: Callable[[Key], int]) -> list[Layer]:
        """Return the nodes in layers, each of which reads earlier ones only."""
        depth: dict[int, int] = {}
        layers: list[list[int]] = []
        for number, (forms, own) in enumerate(zip(self.arguments, self._ranges, strict=True)):
            k = max((1 + depth[at] for at in forms.places.tolist() if at in depth), default=0)
            depth.update(dict.fromkeys(range(own.start, own.stop), k))
            layers += [[] for _ in range(k + 1 - len(layers))]
            layers[k].append(number)
        found = []
        for numbers in layers:
            tables = [k for k in numbers if self.nodes[k].table is not None]
            forms = Forms.of([self.nodes[k].arguments[0] for k in tables], place)
            places = np.array([self._ranges[k].start for k in tables], dtype=np.intp)
            numbers_of = np.array([self._table_of[k] for k in tables], dtype=np.intp)
            functions = [k for k in numbers if self.nodes[k].table is None]
            found.append(Layer(functions, frozenset(tables), numbers_of, forms, places))
        return found

    def before(self, places: Iterable[int]) -> frozenset[int]:
        """Return the nodes on which inputs depend, at once or by way of others."""
        found, open_ones = set(), set(places)
        for number in reversed(range(len(self.nodes))):
            own = self._ranges[number]
            if not open_ones.isdisjoint(range(own.start, own.stop)):
                found.add(number)
                open_ones.update(self.arguments[number].places.tolist())
        return frozenset(found)

    def is_linear_in(self, regions: TableRegions) -> bool:
        """Tell whether all is linear while tables follow the lines of some regions."""
        return self.is_linear and (regions is not None or not self.tables)

    def looked_up(self, q: Array, y: Array) -> Array:
        """Return what each table is looked up at, a line each, from inputs that have been filled."""
        return self.looked_up_forms.at(y, q)

    def looked_up_by(self, number: int, q: Array, y: Array) -> float:
        """Return what one table is looked up at, from inputs that have been filled."""
        return float(self.arguments[self.tables[number]].at(y, q)[0])

    def for_table(self, number: int) -> frozenset[int]:
        """Return the nodes on which the argument of one table depends."""
        return self._for_table[number]

    def argument_majorants(self, q: Array, y: Array) -> Array:
        """Return the majorant of the argument of each table, from inputs that have been filled."""
        return self.looked_up_forms.majorants(y, q)

    def region(self, number: int, x: float) -> int:
        """Return the region of a table in which `x` lies."""
        return int(np.searchsorted(self._corners[number], x, side="right"))

    def borders(self, number: int, region: int) -> tuple[float, float]:
        """Return between which values a region of a table lies."""
        corners = self._corners[number]
        low = float(corners[region - 1]) if region > 0 else -math.inf
        return low, float(corners[region]) if region < corners.size else math.inf

    def all_borders(self, regions: TableRegions) -> Array:
        """Return between which values the region of each table lies: two lines."""
        return self._in_regions(regions)[2:]

    def _in_regions(self, regions: TableRegions) -> Array:
        """Return offset, slope and both borders of each table in its region: four lines."""
        last, found = self._last
        if last is not regions:
            assert regions is not None
            each = [(*self._lines[k][i], *self.borders(k, i)) for k, i in enumerate(regions)]
            found = np.array(each).reshape(-1, 4).T
            self._last = regions, found
        return found

    def _lines_of(self, tables: Indices, x: Array, regions: TableRegions) -> tuple[Array, Array]:
        """Return the offsets and slopes of tables that are looked up at `x`, a line each."""
        if regions is not None:
            offset, slope = self._in_regions(regions)[:2, tables]
            return (offset, slope) if x.ndim == 1 else (offset[:, None], slope[:, None])
        at = [np.searchsorted(self._corners[k], one, side="right") for k, one in zip(tables, x, strict=True)]
        offset, slope = np.stack([self._lines[k][i].T for k, i in zip(tables, at, strict=True)], axis=1)
        return offset, slope

    def _line(self, number: int, x: Array, regions: TableRegions) -> tuple[float, float]:
        """Return offset and slope of the table that a node is."""
        own = np.array([self._table_of[number]])
        offset, slope = self._lines_of(own, np.atleast_1d(x), regions)
        return float(offset[0]), float(slope[0])

    def steepest(self, inputs: int, size: int) -> Any:
        """Return how strongly states can change inputs at most by tables and sums, as a sparse matrix of sizes."""
        rows: dict[int, dict[int, float]] = {}

        def enter(place: int, forms: Forms, line: int, slope: float) -> None:
            found = rows.setdefault(place, {})
            for column, c in _line_of(forms.states, forms.S, line):
                found[column] = found.get(column, 0.0) + slope * c
            for other, c in _line_of(forms.places, forms.P, line):
                for column, of_other in rows.get(other, {}).items():
                    found[column] = found.get(column, 0.0) + slope * c * of_other

        for k, slope in zip(self.tables, self._steepest[1].tolist(), strict=True):
            enter(self._ranges[k].start, self.arguments[k], 0, slope)
        for line, row in enumerate(self.rows.tolist()):
            enter(row, self._normals, line, 1.0)
        entries = [(place, column, c) for place, row in rows.items() for column, c in row.items()]
        places, columns, values = zip(*entries, strict=True) if entries else ((), (), ())
        return scipy.sparse.csr_array((values, (places, columns)), shape=(inputs, size))

    def pattern(self, inputs: int) -> Array:
        """Return numbers where derivatives may differ from 0: random ones, so that none cancel."""
        found = np.zeros((inputs, self.states.size))
        found[self.places] = np.random.default_rng(0).uniform(1.0, 2.0, (self.places.size, self.states.size))
        return found

    def forget(self) -> None:
        """Forget the values of functions, which may not be the same in another run, and how often they were called."""
        self.calls = 0
        for known in self._known:
            known.clear()

    def _called(self, number: int, t: float, arguments: tuple[float, ...]) -> Sequence[float]:
        """Return the values of a function.

        Raises a ValueError with element, time and arguments where the values are no finite numbers.
        """
        node, known = self.nodes[number], self._known[number]
        key = (t if node.timed else 0.0, *arguments)
        found = known.get(key)
        if found is not None:
            return found
        self.calls += 1
        assert node.values is not None
        try:
            found = node.values(t, arguments)
        except ValueError as error:
            raise ValueError(_error_message(node, error, t, arguments)) from error
        if len(known) >= _KEPT:
            known.pop(next(iter(known)), None)
        known[key] = found
        return found

    def _in_floats(self, number: int) -> Callable[..., Any]:
        """Return a function of time and arguments in plain floats."""

        def values(t: float, *arguments: float) -> Sequence[float]:
            return self._called(number, t, arguments)

        def value(t: float, *arguments: float) -> float:
            return self._called(number, t, arguments)[0]

        return values if self.nodes[number].width > 1 else value

    def enter_columns(
        self,
        columns: Columns,
        q: Array,
        y: Array,
        t: float,
        friction: Callable[[int], Callable[[float, float], float]],
        regions: TableRegions,
    ) -> None:
        """Enter the values of inputs that depend on the state, in place; inputs and states are sums over columns.

        Local time runs from `t`. `friction` returns the friction force of a row as a function of its relative velocity
        and normal force. Each table follows the line of its region.
        """
        for number, (node, forms, own) in enumerate(zip(self.nodes, self.arguments, self._ranges, strict=True)):
            arguments = forms.at(y, q)
            if node.table is not None:
                columns.looked_up.append(arguments[0])
                offset, slope = self._line(number, arguments[0], regions)
                q[own] = slope * arguments
                q[own, 0] += offset
                continue
            if node.row < 0:
                given = [columns.time(t), *arguments]
                places = columns.add(self._in_floats(number), given, node.width)
            else:
                # bristles that carry a force are not followed in floats
                places = columns.add(_power_of(friction(node.row)), arguments[:2])
            q[own] = 0.0
            q[own.start + np.arange(node.width), places] = 1.0
        if self.rows.size:
            q[self.rows] += self._normals.at(y, q)

    def fill(
        self,
        q: Array,
        y: Array,
        t: Any,
        tau: Any,
        friction: Friction | None,
        wanted: Collection[int] | None = None,
        regions: TableRegions = None,
    ) -> None:
        """Enter the values of inputs that depend on the state, in place; columns where there are many times.

        `friction` returns the friction forces of a motion, None where its modes are not known yet. Functions may be
        slow: only the nodes `wanted` are computed, None for all, and tables beside wanted ones. Each table follows the
        line of its region, also beyond its borders; without `regions`, the line at its argument.
        """
        for layer in self._layers:
            if layer.tables.size and (wanted is None or not layer.nodes.isdisjoint(wanted)):
                self._enter_tables(layer, q, y, 1.0, regions)
            for number in layer.functions:
                if wanted is None or number in wanted:
                    q[self._ranges[number]] = self._computed(number, q, y, t, tau, friction)
        if self.rows.size:
            q[self.rows] += self._normals.at(y, q)

    def _computed(self, number: int, q: Array, y: Array, t: Any, tau: Any, friction: Friction | None) -> Any:
        """Return the values of a function, columns where there are many times."""
        node, arguments = self.nodes[number], self.arguments[number].at(y, q)
        if q.ndim == 1:
            if node.row < 0:
                return self._called(number, t, tuple(arguments.tolist()))
            return _power(node, arguments, tau, friction)
        if node.row < 0:
            given = zip(t.tolist(), arguments.T.tolist(), strict=True)
            return np.array([self._called(number, time, tuple(x)) for time, x in given]).T
        return [_power(node, arguments[:, k], float(tau[k]), friction) for k in range(q.shape[1])]

    def _enter_tables(self, layer: Layer, q: Array, y: Array, one: Any, regions: TableRegions) -> None:
        """Enter the values of the tables of a layer, in place; their offsets are multiples of `one`."""
        x = layer.forms.at(y, q)
        offset, slope = self._lines_of(layer.tables, x, regions)
        q[layer.places] = slope * x + offset * one

    def add_linear(self, q: Array, y: Array, regions: TableRegions) -> None:
        """Enter the inputs that depend linearly on the state, in place; columns where `q` and `y` have columns.

        `q` and `y` may be values, rates, Taylor coefficients or maps: offsets of tables are multiples of the last
        input, the constant 1.
        """
        for layer in self._layers:
            if layer.tables.size:
                self._enter_tables(layer, q, y, q[-1], regions)
        if self.rows.size:
            q[self.rows] += self._normals.at(y, q)

    def enter_majorants(self, q: Array, y: Array, values: Array, states: Array) -> Array:
        """Make the majorants `q` of inputs, in place, no less than those that follow from arguments.

        `values` and `states` are the inputs and states themselves. The majorant of a table is its slope times that of
        its argument, that of a power the force times that of the velocity.
        """
        for layer in self._layers:
            own = self._steepest[1, layer.tables] * layer.forms.majorants(y, q).T
            q[layer.places] = np.maximum(q[layer.places], own.T)
        for node, forms, own in zip(self.nodes, self.arguments, self._ranges, strict=True):
            if node.row >= 0:
                w, size = np.abs(forms.at(states, values)[0]), forms.majorants(y, q)[0]
                q[own] = np.maximum(q[own], np.abs(values[own]) * np.divide(size, w, out=np.ones_like(w), where=w > 0))
        return q

    def add_majorants(self, q: Array, y: Array, slopes: Sequence[Array] | None, values: Array | None) -> None:
        """Add the majorants of the inputs, in place.

        `slopes` are the derivatives of functions with respect to their arguments, None where all are tables, and
        `values` the inputs themselves, None for their rates.
        """
        if slopes is None:
            for layer in self._layers:
                offset, slope = self._steepest[:, layer.tables]
                sizes = layer.forms.majorants(y, q)
                q[layer.places] += slope * sizes + (0.0 if values is None else offset)
        else:
            for by_arguments, forms, own in zip(slopes, self.arguments, self._ranges, strict=True):
                # the majorant of a function is not known: no less than its value
                sizes = np.abs(by_arguments) @ forms.majorants(y, q)
                q[own] += sizes + (0.0 if values is None else np.abs(values[own]))
        if self.rows.size:
            q[self.rows] += self._normals.majorants(y, q)

    def cancelled(self, q: Array, y: Array) -> Indices:
        """Return the rows whose normal forces are sums that cancel, but for roundoff."""
        own = self._normals.at(y, q)
        sizes = self.normal_majorants(np.abs(q), np.abs(y))[self.rows] + np.abs(q[self.rows] - own)
        return np.asarray(self.rows[np.abs(q[self.rows]) <= _CANCELLED * sizes])

    def normal_majorants(self, q: Array, y: Array) -> Array:
        """Return majorants of normal forces that depend on the state, from those of inputs and states; 0 for others."""
        found = np.zeros(q.size)
        if self.rows.size:
            found[self.rows] = self._normals.majorants(y, q)
        return found

    def argument_majorants_of_states(self, y: Array, inputs: int) -> Array:
        """Return majorants of the arguments of tables, from those of the states; functions are left out."""
        q, slopes = np.zeros(inputs), []
        for k, node in enumerate(self.nodes):
            steepest = self._steepest[1, self._table_of[k]] if node.table is not None else 0.0
            slopes.append(np.full((node.width, len(node.arguments)), steepest))
        self.add_majorants(q, y, slopes, None)
        return self.argument_majorants(q, y)

    def add_changes(self, q: Array, y: Array, slopes: Sequence[Array]) -> None:
        """Add the changes of the inputs that depend on the state, in place, to changes of the other inputs.

        `q` and `y` are changes, a column each; `slopes` are the derivatives of nodes by their arguments.
        """
        for by_arguments, forms, own in zip(slopes, self.arguments, self._ranges, strict=True):
            q[own] += by_arguments @ forms.at(y, q)
        if self.rows.size:
            q[self.rows] += self._normals.at(y, q)

    def slopes(
        self, q: Array, y: Array, t: float, tau: float, friction: Friction, regions: TableRegions = None
    ) -> Array:
        """Return the derivatives of the inputs with respect to `states`."""
        found = np.zeros((q.size, self.states.size))
        # derivatives that overflow are noticed where rates are computed
        with np.errstate(over="ignore", invalid="ignore"):
            by_arguments = self.slopes_by_arguments(q, y, t, tau, friction, regions)
            for slopes, forms, own in zip(by_arguments, self.arguments, self._ranges, strict=True):
                found[own] = slopes @ forms.slopes(self.states, found)
            if self.rows.size:
                found[self.rows] += self._normals.slopes(self.states, found)
        return found

    def slopes_by_arguments(
        self, q: Array, y: Array, t: float, tau: float, friction: Friction, regions: TableRegions = None
    ) -> list[Array]:
        """Return for each node the derivatives of its values with respect to its arguments, a line per value."""
        found = []
        for number, (node, forms) in enumerate(zip(self.nodes, self.arguments, strict=True)):
            arguments = forms.at(y, q)
            if node.table is not None:
                found.append(np.array([[self._line(number, arguments[0], regions)[1]]]))
            elif node.given is not None:
                try:
                    found.append(node.given(t, arguments))
                except ValueError as error:
                    raise ValueError(_error_message(node, error, t, arguments.tolist())) from error
            elif node.row < 0:

                def function(x: Array, number: int = number) -> Array:
                    return np.array(self._called(number, t, tuple(x.tolist())))

                found.append(differences(function, arguments))
            else:

                def heat(x: Array, node: Node = node) -> Array:
                    return np.array([_power(node, x, tau, friction)])

                found.append(differences(heat, arguments))
        return found


def _error_message(node: Node, error: ValueError, t: float, arguments: Sequence[float]) -> str:
    """Return the message about an error of a function, with its element, time and arguments."""
    given = ", ".join(f"{x:.9g}" for x in arguments)
    return f"{node.label} {error} at t = {t:.9g} s with the arguments ({given})"


def _power(node: Node, x: Array, tau: float, friction: Friction | None) -> float:
    w, normal, *deflection = x.tolist()
    if friction is None or not w:
        return 0.0
    return float(w) * friction(node.row, w, max(normal, 0.0), tau, deflection)


def _power_of(force: Callable[[float, float], float]) -> Callable[[float, float], float]:
    return lambda w, normal: w * force(w, normal)
