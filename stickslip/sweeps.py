"""Parameter sweeps: a function evaluated at every point of a grid, in parallel, without losing a point.

Nothing here knows friction: the function takes the parameters by name and returns numbers.
"""

from __future__ import annotations

import hashlib
import json
import math
import multiprocessing
import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence, Set
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass
from itertools import chain, islice, product
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Literal

import numpy as np
from tqdm import tqdm

__all__ = ["SweepInterrupted", "SweepResult", "sweep"]

Index = tuple[int, ...]
Point = dict[str, Any]
Values = dict[str, np.ndarray]
Task = tuple[Index, Point]
Outcomes = Generator[tuple[Index, Values | str], None, None]  # values, or the message of a failure

_WINDOW = 1000  # points handed to a given executor and not yet back; it may stand for a large cluster


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult:
    """Values on a parameter grid.

    Parameters
    ----------
    parameters : dict
        Name -> values, one array per axis of the grid.
    values : dict
        Name -> array of shape grid + shape of one value; NaN where a point failed or is pending.
    failures : dict
        Grid index -> message.
    pending : tuple
        Grid indices that were not reached (after an interrupt).
    """

    parameters: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    failures: dict[Index, str]
    pending: tuple[Index, ...] = ()

    @property
    def shape(self) -> Index:
        """Shape of the grid."""
        return tuple(len(axis) for axis in self.parameters.values())

    def value(self, name: str | None = None) -> np.ndarray:
        """Return the array of a name, or the only one.

        Raises
        ------
        ValueError
            If there is no such name, or no name is given and there are several.
        """
        if name is None and len(self.values) == 1:
            return next(iter(self.values.values()))
        if name is None or name not in self.values:
            raise ValueError(f"value: no value {name!r}; choose from {', '.join(self.values)}")
        return self.values[name]

    def points(self) -> Iterator[tuple[Point, dict[str, Any]]]:
        """Iterate over the points of the grid: parameters and values, both by name."""
        for index, point in _tasks(self.parameters):
            yield point, {name: array[index] for name, array in self.values.items()}

    def to_xarray(self) -> Any:
        """Return an xarray Dataset with the parameters as coordinates.

        Raises
        ------
        ImportError
            If xarray is not installed.
        """
        try:
            import xarray
        except ImportError as missing:
            raise ImportError("to_xarray needs xarray: pip install 'stickslip[frames]'") from missing
        axes, data = tuple(self.parameters), {}
        for name, array in self.values.items():
            inner = tuple(f"{name}_{k}" for k in range(array.ndim - len(axes)))
            data[name] = (axes + inner, array)
        return xarray.Dataset(data, coords={name: (name, axis) for name, axis in self.parameters.items()})

    def __str__(self) -> str:
        """Return a summary: axes, extent of the values, the first failures."""
        total = math.prod(self.shape)
        lines = [f"sweep of {total} points: {len(self.failures)} failed, {len(self.pending)} pending"]
        for name, axis in self.parameters.items():
            others = f" .. {axis[-1]} ({len(axis)} values)" if len(axis) > 1 else ""
            lines.append(f"  {name}: {axis[0]}{others}")
        for name, array in self.values.items():
            finite = array[np.isfinite(array)]
            extent = f"{finite.min():.6g} .. {finite.max():.6g}" if finite.size else "no finite value"
            lines.append(f"  -> {name}: {extent}")
        for index, message in islice(self.failures.items(), 3):
            at = zip(self.parameters.items(), index, strict=True)
            where = ", ".join(f"{name}={axis[i]}" for (name, axis), i in at)
            lines.append(f"  failed at {where}: {message.splitlines()[0]}")
        if len(self.failures) > 3:
            lines.append(f"  and {len(self.failures) - 3} more in .failures")
        return "\n".join(lines)

    __repr__ = __str__


class SweepInterrupted(KeyboardInterrupt):
    """A sweep was interrupted; `result` holds what was computed."""

    def __init__(self, result: SweepResult) -> None:
        """Keep the result."""
        self.result = result
        super().__init__(f"sweep interrupted, {len(result.pending)} points pending; .result has the others")


def sweep(
    function: Callable[..., float | Mapping[str, Any]],
    grid: Mapping[str, Sequence[Any] | np.ndarray],
    *,
    executor: Executor | Literal["serial"] | None = None,
    workers: int | None = None,
    progress: bool = True,
    save: str | os.PathLike[str] | None = None,
) -> SweepResult:
    """Evaluate ``function(**point)`` at every point of a grid.

    A point that fails (even one that kills its process) is recorded and the others go on. The numbers do
    not depend on the executor.

    Parameters
    ----------
    function : callable
        Returns a number, or a mapping of names to numbers or arrays of a fixed shape.
    grid : mapping
        Parameter name -> values.
    executor : Executor, optional
        Any `concurrent.futures.Executor`, or ``Client.get_executor(pure=False)`` of dask; not shut down. By
        default processes are started for the sweep: the function must then be importable, and a script
        must guard its start by ``if __name__ == "__main__":``. ``"serial"`` evaluates here and now.
    workers : int, optional
        Number of processes to start; by default one per core.
    progress : bool
        Show a progress bar.
    save : path, optional
        File to which each finished point is appended (JSON Lines). A sweep of the same grid resumes
        from it; failed points are tried again. It cannot know whether the function has changed.

    Raises
    ------
    SweepInterrupted
        On Ctrl-C, with what was computed in `result`.
    TypeError, ValueError
        If an argument makes no sense, or `save` names a file of another sweep.
    """
    if not callable(function):
        raise TypeError(f"sweep: function must be callable, got {function!r}")
    parameters = _parameters(grid)
    if not (executor is None or executor == "serial" or isinstance(executor, Executor)):
        raise TypeError(f"sweep: executor must be an Executor, 'serial' or None, got {executor!r}")
    if workers is not None and executor is not None:
        raise ValueError(
            f"sweep: workers={workers!r} is for processes of our own; leave out executor or workers"
        )
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise ValueError(f"sweep: workers must be a whole number >= 1, got {workers!r}")

    log = None if save is None else _Log(Path(save), parameters)
    done: dict[Index, Values | str] = {} if log is None else log.load()
    total = math.prod(len(axis) for axis in parameters.values())
    todo = (task for task in _tasks(parameters) if task[0] not in done)
    outcomes: Outcomes
    if executor is None:
        processes = min(workers or os.cpu_count() or 1, 61, max(total - len(done), 1))
        outcomes = _own_processes(function, todo, processes)
    elif isinstance(executor, Executor):
        outcomes = _through(executor, function, todo, _WINDOW)
    else:
        outcomes = ((index, _evaluate(function, point)) for index, point in todo)
    bar = tqdm(total=total, initial=len(done), disable=not progress, unit="point")
    try:
        with bar, closing(outcomes), log or nullcontext():
            failed = 0
            for index, outcome in outcomes:
                done[index] = outcome
                if log:
                    log.append(index, outcome)
                if isinstance(outcome, str):
                    failed += 1
                    bar.set_postfix(failed=failed, refresh=False)
                bar.update()
    except KeyboardInterrupt:
        raise SweepInterrupted(_collect(parameters, done)) from None
    return _collect(parameters, done)


def _parameters(grid: Mapping[str, Sequence[Any] | np.ndarray]) -> dict[str, np.ndarray]:
    if not isinstance(grid, Mapping) or not grid:
        raise TypeError(f"sweep: grid must map parameter names to values, got {grid!r}")
    return {name: _axis(name, given) for name, given in grid.items()}


def _axis(name: str, given: Sequence[Any] | np.ndarray) -> np.ndarray:
    """Return the values as an array: of numbers or texts where they are alike, else of objects."""
    if not isinstance(name, str):
        raise TypeError(f"sweep: parameter names must be texts, got {name!r}")
    if isinstance(given, str | bytes | Mapping | Set) or not isinstance(given, Iterable):
        raise TypeError(
            f"sweep: grid[{name!r}] must be a sequence of values, got {given!r}; write [{given!r}]"
        )
    if isinstance(given, np.ndarray) and given.ndim != 1:
        raise ValueError(f"sweep: grid[{name!r}] must have one dimension, not {given.ndim}; ravel it")
    values = [item.item() if isinstance(item, np.number | np.bool_ | np.str_) else item for item in given]
    if not values:
        raise ValueError(f"sweep: grid[{name!r}] is empty; give at least one value")
    with suppress(TypeError):  # values that cannot be hashed are not compared
        if len(set(values)) < len(values):
            raise ValueError(f"sweep: grid[{name!r}] has a value twice, leave one out: {values!r}")
    kinds = {type(item) for item in values}
    if kinds <= {int, float} or kinds in ({bool}, {str}):
        return np.array(values)
    axis = np.empty(len(values), dtype=object)
    for k, item in enumerate(values):
        axis[k] = item
    return axis


def _tasks(parameters: Mapping[str, np.ndarray]) -> Iterator[Task]:
    """Iterate over grid indices and points, the last parameter fastest."""
    axes = [list(enumerate(axis.tolist())) for axis in parameters.values()]
    for combination in product(*axes):
        index = tuple(i for i, _ in combination)
        yield index, {name: value for name, (_, value) in zip(parameters, combination, strict=True)}


def _evaluate(function: Callable[..., Any], point: Point) -> Values | str:
    """Return the values at a point, or the message of its failure."""
    try:
        returned = function(**point)
        named = returned if isinstance(returned, Mapping) else {"value": returned}
        if not named:
            raise ValueError("the function returned no value; return at least one")
        values = {}
        for name, value in named.items():
            array = np.asarray(value)
            if not isinstance(name, str) or name in point:
                raise ValueError(f"the function names a value {name!r}; take a text that is no parameter")
            if array.dtype.kind not in "biuf":
                raise TypeError(
                    f"the function returned {name} of type {type(value).__name__}; return numbers"
                )
            values[name] = array.astype(float)
        return values
    except (Exception, SystemExit) as exception:
        return _message(exception)


def _message(exception: BaseException) -> str:
    return f"{type(exception).__name__}: {exception}"


def _through(
    executor: Executor,
    function: Callable[..., Any],
    todo: Iterable[Task],
    window: int,
    lost: list[Task] | None = None,
) -> Outcomes:
    """Yield outcomes as they come, with at most `window` points on their way.

    Points on their way when the executor broke down are added to `lost` if given, else they failed.
    """
    finished: SimpleQueue[Future] = SimpleQueue()
    waiting: dict[Future, Task] = {}
    todo = iter(todo)
    try:
        while True:
            for task in islice(todo, window - len(waiting)):
                future = _submit(executor, function, task[1])
                waiting[future] = task
                future.add_done_callback(finished.put)
            if not waiting:
                return
            future = finished.get()
            task = waiting.pop(future)
            if lost is not None and isinstance(future.exception(), BrokenExecutor):
                lost.append(task)
            else:
                yield task[0], _outcome(future)
    except KeyboardInterrupt:
        for future, task in waiting.items():
            if not future.cancel() and future.done() and future.exception() is None:
                yield task[0], future.result()
        raise
    finally:
        for future in waiting:
            future.cancel()


def _submit(executor: Executor, function: Callable[..., Any], point: Point) -> Future:
    try:
        return executor.submit(_evaluate, function, point)
    except BrokenExecutor as broken:
        future: Future = Future()
        future.set_exception(broken)
        return future


def _outcome(future: Future) -> Values | str:
    try:
        return future.result()
    except Exception as exception:
        return _message(exception)


def _own_processes(function: Callable[..., Any], todo: Iterator[Task], workers: int) -> Outcomes:
    """Yield outcomes from processes of our own.

    A point that kills its process breaks the whole pool: the points then on their way are evaluated again
    one by one, which shows the culprit, before the others go on in a fresh pool.
    """
    lost: list[Task] = []
    for task in todo:
        others = iter(lambda: None if lost else next(todo, None), None)
        yield from _in_pool(function, chain([task], others), workers, lost)
        while lost:
            yield from _in_pool(function, [lost.pop(0)], 1, None)


def _in_pool(
    function: Callable[..., Any], todo: Iterable[Task], workers: int, lost: list[Task] | None
) -> Outcomes:
    pool = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),  # safe with threads, and the same on every system
        initializer=signal.signal,  # Ctrl-C ends a worker without a traceback
        initargs=(signal.SIGINT, signal.SIG_DFL),
    )
    complete = False
    try:
        try:
            pool.submit(callable, function).result()
        except Exception as exception:
            raise TypeError(
                f"sweep: {function!r} cannot be handed to other processes ({exception}). Define it at the "
                "top of a module, guard a script by if __name__ == '__main__':, or give executor='serial'"
            ) from exception
        yield from _through(pool, function, todo, 2 * workers, lost)
        complete = True
    finally:
        pool.shutdown(wait=complete, cancel_futures=True)


class _Log:
    """Finished points in a file, one JSON line each, from which a later sweep of the same grid resumes."""

    def __init__(self, path: Path, parameters: dict[str, np.ndarray]) -> None:
        self.path = path
        self.axes = {name: axis.tolist() for name, axis in parameters.items()}
        try:
            digest = hashlib.sha256(json.dumps(list(self.axes.items())).encode()).hexdigest()[:16]
        except TypeError as exception:
            raise TypeError(f"sweep: save needs parameters that are numbers or texts ({exception})") from None
        self.head = f'{{"grid": "{digest}", '

    def load(self) -> dict[Index, Values | str]:
        """Return the points that succeeded, and cut off a last line that a crash left torn."""
        done: dict[Index, Values | str] = {}
        content = self.path.read_bytes() if self.path.exists() else b""
        *lines, torn = content.split(b"\n")
        head = self.head.encode()
        if torn[: len(head)] != head[: len(torn)] or not all(line.startswith(head) for line in lines):
            raise ValueError(
                f"sweep: {str(self.path)!r} does not belong to this sweep of {', '.join(self.axes)}: it has "
                "other parameters or values, or is something else. Give another file, or the same grid"
            )
        for line in lines:
            record = json.loads(line)
            if "values" in record:
                values = record["values"].items()
                done[tuple(record["index"])] = {name: np.array(value, dtype=float) for name, value in values}
        if torn:
            os.truncate(self.path, len(content) - len(torn))
        return done

    def append(self, index: Index, outcome: Values | str) -> None:
        record: dict[str, Any] = {"index": index}
        record["point"] = {name: axis[i] for (name, axis), i in zip(self.axes.items(), index, strict=True)}
        if isinstance(outcome, str):
            record["failure"] = outcome
        else:
            record["values"] = {name: array.tolist() for name, array in outcome.items()}
        self.file.write(self.head + json.dumps(record)[1:] + "\n")
        self.file.flush()

    def __enter__(self) -> None:
        """Open the file to append."""
        self.file = self.path.open("a", encoding="utf-8", newline="\n")

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.file.close()


def _collect(parameters: dict[str, np.ndarray], done: Mapping[Index, Values | str]) -> SweepResult:
    """Return the outcomes as arrays; what the first good point returned sets the names and shapes."""
    shape = tuple(len(axis) for axis in parameters.values())
    failures: dict[Index, str] = {}
    pending: list[Index] = []
    expected: dict[str, Index] | None = None
    values: Values = {}
    for index in np.ndindex(shape):
        outcome = done.get(index)
        if outcome is None:
            pending.append(index)
            continue
        if isinstance(outcome, str):
            failures[index] = outcome
            continue
        found = {name: array.shape for name, array in outcome.items()}
        if expected is None:
            expected = found
            values = {name: np.full(shape + inner, np.nan) for name, inner in found.items()}
        if found != expected:
            failures[index] = f"ValueError: the function returned shapes {found}, before {expected}"
            continue
        for name, array in outcome.items():
            values[name][index] = array
    return SweepResult(parameters, values or {"value": np.full(shape, np.nan)}, failures, tuple(pending))
