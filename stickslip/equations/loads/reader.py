"""Quantities of the motion resolved to linear forms of states and inputs, and to functions among the inputs.

``q = loads(t) + S y + P q + f``: `S` and `P` are constant, and `f` are the values of functions (`feedback`, tables,
blocks), each an entry of `q` of its own. Linear forces need no entry: they are part of the matrices of the system.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import numpy as np

from stickslip.model import quantities as of
from stickslip.model.arrays import Array
from stickslip.model.elements import AnyBlock, Block, Sampled, StateSpace
from stickslip.model.elements.book import Book
from stickslip.model.quantities import Expression, Quantity
from stickslip.model.signals import Constant, Load, Signal
from stickslip.model.slopes import slopes_by_differences

_Found = TypeVar("_Found")
Key = tuple[str, int, int]  # kind of an input, its number, and for functions which of their values
_STEP, _SMALL = 1e-5, 1e-3  # the step of a difference is the first of the argument, or of the second if this is larger


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


@dataclass(frozen=True)
class Node:
    """A function among the inputs, that returns `width` values; `label` is how messages name it."""

    label: str
    arguments: list[Form]
    # ``values(t, arguments)`` returns `width` numbers; None for heat and tables
    values: Callable[[float, Sequence[float]], Sequence[float]] | None = None
    # ``given(t, arguments)`` returns their derivatives, a line each; None where differences are taken
    given: Callable[[float, Array], Array] | None = None
    row: int = -1  # the row whose heat it is, -1 for a function
    width: int = 1
    timed: bool = False  # whether it depends on time beside its arguments
    is_rate: bool = False  # whether its values are rates of the states of a block, and nothing else
    table: of.Table | None = None  # straight lines, each of which holds in a region of the one argument


def differences(function: Callable[[Array], Array], arguments: Array) -> Array:
    """Return the derivatives of a function by differences of second order ahead, a line per value.

    Steps go to one side only: a function may end at 0.
    """

    def along(k: int, x: float) -> list[float]:
        moved = arguments.copy()
        moved[k] = x
        found: list[float] = function(moved).tolist()
        return found

    steps = [_STEP * max(abs(x), _SMALL) for x in arguments.tolist()]
    columns = [
        slopes_by_differences(partial(along, k), x, h, 2 * h)
        for k, (x, h) in enumerate(zip(arguments.tolist(), steps, strict=True))
    ]
    return np.array(columns).T if columns else np.zeros((function(arguments).size, 0))


class Reader:
    """Resolves quantities to linear forms.

    `position_state` are the places of the positions of bodies and drives in the state, `bristle_state` those of the
    bristles of rows, and `places` those of blocks.
    `signals` are the loads that are inputs of their own, and `nodes` the functions, each after those that it depends
    on. If it `shares`, a load or function that is read at several places is one input; `is_shared` tells whether there
    is one.
    """

    def __init__(
        self,
        book: Book,
        position_state: dict[int, int],
        bristle_state: dict[int, int],
        places: dict[str, BlockPlace],
        shares: bool = True,
    ) -> None:
        self._shares, self.is_shared = shares, False
        self._book, self._position_state, self._places = book, position_state, places
        self._bristle_state = bristle_state
        self._functions: dict[str, int] = {}
        self._row_of = book.row_index
        self._resolving: list[tuple[Quantity, str]] = []
        self._known: dict[Quantity, Form] = {}
        self.signals: list[Signal] = []
        self.nodes: list[Node] = []
        self.velocities_read: set[int] = set()
        """The rows whose relative velocities are read."""

    def form(self, load: Load, label: str) -> Form:
        """Return a quantity or a signal as a linear form; `label` is the element that reads it."""
        if isinstance(load, Signal):
            return self._of_signal(load, label)
        if isinstance(load, Expression):
            found = self._of_signal(load.signal, label)
            for atom, factor in load.terms:
                found.add(self.form(atom, label), factor)
            return found
        assert isinstance(load, Quantity)
        known = self._known.get(load)
        is_own = isinstance(load, (of.Feedback, of.Table))
        if known is None or (is_own and not self._shares):
            known = self._known[load] = self._resolved(load, label)
        elif is_own:
            self.is_shared = True
        return known

    def _resolved(self, atom: Quantity, label: str) -> Form:
        book = self._book
        match atom:
            case of.Velocity(body=body):
                return self._velocity(book.index[body])
            case of.Position(body=body):
                return self._position(book.index[body])
            case of.RelativeVelocity(row=row):
                self.velocities_read.add(self._row_of[row])
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
                        lambda t, x: (atom.value(x),),
                        None if atom.derivatives is None else lambda t, x: atom.slopes(x.tolist())[None, :],
                    )
                )
            case of.Table():
                return self._lookup(self.form(atom.quantity, label), atom, label)
        raise TypeError(f"{label}: unknown quantity {atom!r}")

    def _lookup(self, form: Form, atom: of.Table, label: str) -> Form:
        return self._node(Node(label, [form], table=atom))

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
            unread = [math.nan] * len(block.quantities())

            def values(t: float, x: Sequence[float]) -> Sequence[float]:
                u = x[states:] if reads else unread
                return block.call("output", t, x[:states], u, width, exactly=False)

            node = Node(f"{block.label}:", arguments, values, width=width, timed=True)
            ((_, self._functions[name], _),) = self._node(node).inputs
        return Form(inputs={("node", self._functions[name], index): 1.0})

    def of_block(self, block: AnyBlock, label: str, inputs: bool = True) -> list[Form]:
        """Return the states of a block, and its inputs where these are wanted."""
        place = self._places[block.name]
        states = [Form({place.first + k: 1.0}) for k in range(place.states)]
        return states + [self.form(u, label) for u in block.quantities() if inputs]

    def linear_output(self, block: StateSpace, index: int, label: str) -> Form:
        """Return ``C x + D u`` of one output of a linear block, before it is limited."""
        first = self._places[block.name].first
        found = Form({first + k: c for k, c in enumerate(block.C[index]) if c})
        for u, c in zip(block.quantities(), block.D[index], strict=True):
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
        # all inputs are resolved, even those that nothing but results reads
        inputs = [self.form(u, label) for u in block.quantities()]
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

        def values(t: float, x: Sequence[float]) -> Sequence[float]:
            return block.call("derivative", t, x[:count], x[count:], count, exactly=True)

        node = Node(f"{block.label}:", self.of_block(block, label), values, width=count, timed=True, is_rate=True)
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

    def _of_signal(self, signal: Signal, label: str) -> Form:
        if isinstance(signal, Constant):
            return Form(inputs={("one", 0, 0): signal.value}) if signal.value else Form()
        if self._shares and signal in self.signals:
            self.is_shared = True
            return Form(inputs={("signal", self.signals.index(signal), 0): 1.0})
        self.signals.append(signal.read_by(label))
        return Form(inputs={("signal", len(self.signals) - 1, 0): 1.0})

    def _normal(self, atom: Quantity, row: str) -> Form:
        j = self._row_of[row]
        entry = self._book.rows[j]
        if entry.pressing is not None:
            return self.form(entry.pressing(), f"the force of gap {row!r}")
        load = entry.normal
        if isinstance(load, Signal):
            return Form(inputs={("normal", j, 0): 1.0})
        label = f"the normal force of contact {row!r}"
        own = self._inside(atom, label, lambda: self.form(load, label))
        return self._lookup(own, of.Table(of.TIME, (0.0,), (0.0,), 0.0, 1.0), label)

    def _power(self, atom: Quantity, row: str) -> Form:
        label = f"the power of contact {row!r}"
        normal = self._inside(atom, label, lambda: self.form(of.Normal(row), label))
        w = self._along(row, self._velocity)
        j = self._row_of[row]
        bristles = [Form({self._bristle_state[j]: 1.0})] if j in self._bristle_state else []
        return self._node(Node(label, [w, normal, *bristles], row=j))

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
