"""Blocks: parts of a scene with states of their own, such as controllers, actuators and temperatures."""

from __future__ import annotations

import dis
import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, cast

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.checks import in_order, limit, sequence, whole
from stickslip.model.elements.base import Named
from stickslip.model.elements.book import Book
from stickslip.model.quantities import Expression, as_expression
from stickslip.model.signals import Load

BlockFunction = Callable[[float, Array, Array], Any]
BlockInputs = Sequence[Load | float]  # inputs as users give them; a block holds them as expressions
Numbers = Sequence[float]

_VARARGS, _KEYWORDS = inspect.CO_VARARGS, inspect.CO_VARKEYWORDS
_MOST_SAMPLES = 1e7


class AnyBlock(Named):
    """Base class of all blocks: a name, inputs, and states at the start."""

    inputs: BlockInputs
    states: Numbers | None

    @property
    def label(self) -> str:
        """How messages name the block."""
        return f"block {self.name!r}"

    def place(self, book: Book) -> None:
        """Enter a block."""
        book.block(self)

    def quantities(self) -> tuple[Expression, ...]:
        """Return the inputs."""
        return cast("tuple[Expression, ...]", self.inputs)

    @property
    def output_count(self) -> int | None:
        """How many outputs it has; None where this is unknown until its function is called."""
        count: int | None = getattr(self, "outputs", None)
        return count

    def to_dict(self) -> dict[str, Any]:
        """Refuse: code is not data."""
        raise ValueError(f"a {self.noun()} is code, not data; of blocks a file holds StateSpace only")

    def _check_inputs(self) -> None:
        given: Any = self.inputs
        what = f"{self.label}: inputs"
        alone = isinstance(given, (Load, int, float))
        loads = [given] if alone else in_order(given, what, "quantities such as [velocity('a')]")
        inputs = tuple(as_expression(load, f"{self.label}: input {k}") for k, load in enumerate(loads))
        object.__setattr__(self, "inputs", inputs)

    def _numbers(self, name: str) -> Numbers:
        given = getattr(self, name)
        listed = [given] if isinstance(given, (int, float)) else given
        numbers = sequence(listed, f"{self.label}: {name}")
        object.__setattr__(self, name, numbers)
        return numbers

    def _check_code(self, advance: str, outputs_are_states: bool) -> None:
        """Check the states, the function named `advance`, the function `output`, and the number of outputs.

        If `outputs_are_states`, a block with states may leave `output` out: its outputs are then its states.
        """
        states, outputs = self._numbers("states"), getattr(self, "outputs", None)
        needs_output = not (states and outputs_are_states)
        for name, needed in ((advance, bool(states)), ("output", needs_output)):
            given = getattr(self, name)
            if not callable(given) and (given is not None or needed):
                raise TypeError(f"{self.label}: {name} must be a function of t, x and u, got {given!r}")
        if getattr(self, advance) is not None and not states:
            raise ValueError(f"{self.label}: {advance} is given without states; give states at the start")
        if outputs is not None:
            object.__setattr__(self, "outputs", whole(outputs, f"{self.label}: outputs", 1))

    def call(
        self,
        name: str,
        t: float,
        x: Sequence[float] | Array,
        u: Sequence[float] | Array,
        count: int,
        exactly: bool,
    ) -> list[float]:
        """Return `count` finite numbers from the block's function `name`; a ValueError says what is wrong.

        The function returns `count` numbers `exactly`, or may return more.
        """
        try:
            found = np.array(getattr(self, name)(t, np.array(x, dtype=float), np.array(u, dtype=float)), dtype=float)
        except Exception as error:
            raise ValueError(f"{name} raised {error!r}") from error
        enough = found.ndim < 2 and (found.size == count if exactly else found.size >= count)
        if not enough:
            raise ValueError(
                f"{name} returned {found.tolist()!r}, but {count} {'number is' if count == 1 else 'numbers are'} needed"
            )
        numbers: list[float] = found.ravel().tolist()
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"{name} returned {found.tolist()!r}")
        return numbers[:count]


@dataclass(frozen=True)
class Block(AnyBlock):
    """A block of any smooth functions: ``x' = derivative(t, x, u)``, ``y = output(t, x, u)``.

    Parameters
    ----------
    name : str
        Unique among blocks.
    inputs : sequence of Quantity, Signal or float
        u, in order.
    states : sequence of float
        x at the start.
    derivative : callable, optional
        ``derivative(t, x, u)`` returns as many numbers as there are states.
    output : callable, optional
        ``output(t, x, u)`` returns a number or a sequence of them; without it the states are the outputs.
    outputs : int, optional
        How many outputs there are; by default as many as the scene reads, at least one.

    Raises
    ------
    TypeError, ValueError
        If an input is no quantity, a state no number, or a function no function.
    """

    name: str
    _: KW_ONLY
    inputs: BlockInputs = ()
    states: Numbers = ()
    derivative: BlockFunction | None = None
    output: BlockFunction | None = None
    outputs: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_inputs()
        self._check_code("derivative", outputs_are_states=True)

    @property
    def output_count(self) -> int | None:
        """How many outputs it has; None where this is unknown until its function is called."""
        return len(self.states) if self.output is None else self.outputs

    @property
    def feeds_through(self) -> bool:
        """Whether the outputs may depend on the inputs at the same instant; a function that never reads u does not."""
        return self.output is not None and _reads_inputs(self.output)


@dataclass(frozen=True)
class StateSpace(AnyBlock):
    """A linear block: ``x' = A x + B u``, ``y = C x + D u``; it is exact in the series engine.

    Parameters
    ----------
    name : str
        Unique among blocks.
    A, B, C, D : array
        ``A`` may also be a system of scipy.signal, a transfer function too, or a state space of python-control; without
        `D` it is 0.
    inputs : sequence of Quantity, Signal or float
        u, in order.
    states : sequence of float, optional
        x at the start, by default 0.
    limits : sequence of (float, float), optional
        For each output the limits beyond which it is cut off; the corners are located like events.

    Raises
    ------
    TypeError, ValueError
        If the sizes do not fit together, a number is not finite, or a system is one of discrete time.
    """

    called = "state space"

    name: str
    A: Any
    B: Any = None
    C: Any = None
    D: Any = None
    _: KW_ONLY
    inputs: BlockInputs = ()
    states: Numbers | None = None
    limits: Sequence[tuple[float, float]] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_inputs()
        if self.B is None and self.C is None:
            self._take(self.A.to_ss() if hasattr(self.A, "to_ss") else self.A)
        n, columns = self._matrix("A", None, None).shape
        if columns != n:
            raise ValueError(f"{self.label}: A must be square, got {np.shape(self.A)}")
        m = len(self.inputs)
        self._matrix("B", n, m)
        p = self._matrix("C", None, n).shape[0]
        if p == 0:
            raise ValueError(f"{self.label}: C has no row; give at least one output")
        if self.D is None:
            object.__setattr__(self, "D", np.zeros((p, m)))
        self._matrix("D", p, m)
        for name in "ABCD":
            rows = tuple(tuple(row) for row in np.asarray(getattr(self, name), dtype=float).tolist())
            object.__setattr__(self, name, rows)
        if self.states is None:
            object.__setattr__(self, "states", (0.0,) * n)
        if len(self._numbers("states")) != n:
            raise ValueError(f"{self.label}: {len(self.states or ())} states, but A has {n} rows")
        if self.limits is not None:
            self._check_limits(p)

    def _take(self, system: Any) -> None:
        """Take the matrices of a system of another package, if it is one."""
        if not hasattr(system, "A"):
            if hasattr(system, "num"):
                raise TypeError(f"{self.label}: give the state space of the transfer function, control.ss(system)")
            return
        if (dt := getattr(system, "dt", None)) not in (None, 0):
            raise ValueError(f"{self.label}: the system has a sample time of {dt}; give Sampled(...) for discrete time")
        for name in "ABCD":
            object.__setattr__(self, name, np.asarray(getattr(system, name), dtype=float))

    def _matrix(self, name: str, rows: int | None, columns: int | None) -> Array:
        given = getattr(self, name)
        try:
            found = np.array(given)
        except ValueError:  # rows of different lengths
            found = np.array(None)
        if found.dtype.kind not in "iuf":
            raise TypeError(f"{self.label}: {name} must be a matrix, got {given!r}")
        found = found.astype(float)
        if found.size == 0:
            empty = found.shape[0] if rows is None else rows, found.shape[-1] if columns is None else columns
            found = np.zeros(empty)
        elif found.ndim == 0 or (found.ndim == 1 and name == "B" and rows == found.size):
            found = found.reshape(-1, 1)
        elif found.ndim == 1:
            found = found.reshape(1, -1)
        expected = (found.shape[0] if rows is None else rows, found.shape[1] if columns is None else columns)
        if found.ndim != 2 or found.shape != expected:
            raise ValueError(
                f"{self.label}: {name} has the shape {found.shape}, but {expected} fits to the other "
                f"matrices and the {len(self.inputs)} inputs"
            )
        if not np.isfinite(found).all():
            raise ValueError(f"{self.label}: {name} must be finite, got {found.tolist()}")
        object.__setattr__(self, name, found)
        return found

    def _check_limits(self, count: int) -> None:
        pairs: list[tuple[float, float]] = []
        what = f"{self.label}: limits"
        for given in in_order(self.limits, what, "pairs (low, high)"):
            if len(ends := in_order(given, what, "pairs (low, high)")) != 2:
                raise ValueError(f"{what} must be pairs (low, high), got {given!r}")
            low = limit(ends[0], -math.inf, f"{self.label}: low limit")
            high = limit(ends[1], math.inf, f"{self.label}: high limit")
            if not low < high:
                raise ValueError(f"{self.label}: the low limit {low:g} must be below the high one {high:g}")
            pairs.append((low, high))
        if len(pairs) != count:
            raise ValueError(f"{self.label}: {len(pairs)} pairs of limits for {count} outputs")
        object.__setattr__(self, "limits", tuple(pairs))

    @property
    def output_count(self) -> int:
        """How many outputs it has."""
        return len(self.C)

    def to_dict(self) -> dict[str, Any]:
        """Return the block as plain data."""
        data: dict[str, Any] = {"name": self.name}
        data |= {name: [list(row) for row in getattr(self, name)] for name in "ABCD"}
        data["inputs"] = [one.to_dict() for one in self.quantities()]
        if any(self.states or ()):
            data["states"] = list(self.states or ())
        if self.limits is not None:
            data["limits"] = [[x if math.isfinite(x) else str(x) for x in pair] for pair in self.limits]
        return data


@dataclass(frozen=True)
class Sampled(AnyBlock):
    """A block of discrete time, such as a digital controller.

    At each ``t_k = first + k period`` it reads its inputs (left limits) and holds ``y_k = output(t_k, x_k, u_k)`` until
    the next sample; then ``x_{k+1} = update(t_k, x_k, u_k)``. Both are called once for each sample. The times are sums
    of decimals: 3 times 0.1 s is 0.3 s.

    Parameters
    ----------
    name : str
        Unique among blocks.
    period : float
        In s, positive.
    inputs : sequence of Quantity, Signal or float
        u, in order.
    states : sequence of float
        x at the start.
    update : callable, optional
        ``update(t, x, u)`` returns the next states.
    output : callable
        ``output(t, x, u)`` returns a number or a sequence of them.
    outputs : int, optional
        How many outputs there are; by default as many as the scene reads, at least one.
    first : float, optional
        Time in s of the first sample, or of one before the start; by default the start of the simulation.
    held : sequence of float
        The outputs until the first sample, by default 0.

    Raises
    ------
    TypeError, ValueError
        If an input is no quantity, a number not finite, the period not positive, or a function no function.
    """

    called = "sampled block"

    name: str
    _: KW_ONLY
    period: float
    inputs: BlockInputs = ()
    states: Numbers = ()
    update: BlockFunction | None = None
    output: BlockFunction
    outputs: int | None = None
    first: float | None = None
    held: Numbers = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self._number("period") <= 0:
            raise ValueError(f"{self.label}: period must be positive, got {self.period:g}")
        self._check_inputs()
        self._check_code("update", outputs_are_states=False)
        if self.first is not None:
            self._number("first")
        self._numbers("held")
        if self.outputs is None and self.held:
            object.__setattr__(self, "outputs", len(self.held))
        if self.held and len(self.held) != self.outputs:
            raise ValueError(f"{self.label}: {len(self.held)} held outputs, but outputs = {self.outputs}")

    def instants(self, start: float, stop: float) -> list[float]:
        """Return the sample times from `start` on and before `stop`.

        Raises
        ------
        ValueError
            If there are more than ten million.
        """
        if (count := (stop - start) / self.period) > _MOST_SAMPLES:
            raise ValueError(
                f"{self.label}: a period of {self.period:g} s makes {count:.3g} samples in {stop - start:g} s, "
                f"and {_MOST_SAMPLES:g} are the most; give a longer period, or simulate a shorter time"
            )
        first = start if self.first is None else self.first
        k = max(0, math.floor((start - first) / self.period) - 1)
        found = []
        while (t := _instant(first, self.period, k)) < stop:
            if t >= start:
                found.append(t)
            k += 1
        return found

    def is_due(self, t: float, start: float) -> bool:
        """Tell whether a sample is taken at `t` in a simulation that began at `start`."""
        first = start if self.first is None else self.first
        k = round((t - first) / self.period)
        return k >= 0 and _instant(first, self.period, k) == t


def _instant(first: float, period: float, k: int) -> float:
    """Return ``first + k period``, computed in decimals and rounded once: 3 times 0.1 is 0.3, where a load may jump."""
    a, b, whole = _decimals(first, period)
    return (a + k * b) / whole


@lru_cache(maxsize=64)
def _decimals(first: float, period: float) -> tuple[int, int, int]:
    """Return the numerators of the shortest decimals of two numbers over a common denominator, and that."""
    a, b = Fraction(str(float(first))), Fraction(str(float(period)))
    whole = math.lcm(a.denominator, b.denominator)
    return int(a * whole), int(b * whole), whole


def _reads_inputs(function: Any) -> bool:
    """Tell whether a function of t, x and u reads u; True, too, where its code cannot be inspected."""
    bound = int(inspect.ismethod(function))
    code = getattr(function, "__code__", None)
    if code is None or code.co_argcount < 3 + bound or code.co_flags & (_VARARGS | _KEYWORDS):
        return True
    name = code.co_varnames[2 + bound]
    named = [instruction.argval for instruction in dis.get_instructions(code)]
    return any(name in one if isinstance(one, tuple) else name == one for one in named)
