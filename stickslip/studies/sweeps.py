"""Parameter sweeps: a function evaluated at every point of a grid, in parallel, without losing a point.

Nothing here knows friction: the function takes the parameters by name and returns numbers.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence, Set
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import closing, nullcontext, suppress
from itertools import islice
from multiprocessing.connection import wait
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Literal

import numpy as np
from tqdm import tqdm

from stickslip.model.checks import check_takes, flag, whole
from stickslip.studies.sweep_data import (
    GridPoint,
    Index,
    Point,
    SweepLog,
    SweepResult,
    Values,
    collect,
    grid_points,
)

__all__ = ["SweepInterrupted", "SweepResult", "sweep"]

Outcomes = Generator[tuple[Index, Values | str], None, None]  # values, or the message of a failure

_WINDOW = 1000  # most points that an executor of the user has at a time: it may stand for a large cluster


class SweepInterrupted(KeyboardInterrupt):
    """A sweep was interrupted; `result` holds what was computed."""

    def __init__(self, result: SweepResult) -> None:
        """Keep the result."""
        self.result = result
        super().__init__(f"sweep interrupted, {len(result.pending)} points pending; .result has the others")

    def __reduce__(self) -> tuple[Any, ...]:
        """Let it come back from another process with its result."""
        return type(self), (self.result,), self.__dict__


def sweep(
    function: Callable[..., float | Mapping[str, Any]],
    grid: Mapping[str, Sequence[Any] | np.ndarray],
    *,
    executor: Executor | Literal["serial"] | None = None,
    workers: int | None = None,
    progress: bool = True,
    save: str | os.PathLike[str] | None = None,
    version: str = "",
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
    version : str
        Any text that identifies what the function computes. A file that was saved under another one is refused.

    Raises
    ------
    SweepInterrupted
        On Ctrl-C, with what was computed in `result`.
    TypeError, ValueError
        If an argument makes no sense, or `save` names a file of another sweep.
    """
    parameters = _parameters(grid)
    _check(function, executor, workers, progress, save, version)
    log = None if save is None else SweepLog(Path(save), parameters, version)
    check_takes(function, 0, "sweep: function", f"{', '.join(parameters)} by name", parameters)
    done: dict[Index, Values | str] = {} if log is None else log.load()
    total = math.prod(len(axis) for axis in parameters.values())
    todo = (task for task in grid_points(parameters) if task[0] not in done)
    outcomes: Outcomes
    if executor is None:
        processes = min(workers or os.cpu_count() or 1, 61, max(total - len(done), 1))
        outcomes = _own_processes(function, todo, processes)
    elif isinstance(executor, Executor):
        outcomes = _elsewhere(executor, function, todo)
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
        raise SweepInterrupted(collect(parameters, done)) from None
    return collect(parameters, done)


def _check(function: Any, executor: Any, workers: Any, progress: Any, save: Any, version: Any) -> None:
    """Refuse arguments of `sweep` that make no sense."""
    if not callable(function):
        raise TypeError(f"sweep: function must be callable, got {function!r}")
    flag(progress, "sweep: progress")
    if not isinstance(version, str):
        raise TypeError(f"sweep: version must be a text, got {version!r}")
    is_serial = isinstance(executor, str) and executor == "serial"
    if not (executor is None or is_serial or isinstance(executor, Executor)):
        raise TypeError(f"sweep: executor must be an Executor, 'serial' or None, got {executor!r}")
    if workers is not None and executor is not None:
        raise ValueError(f"sweep: workers={workers!r} is for processes of our own; leave out executor or workers")
    if workers is not None:
        whole(workers, "sweep: workers", 1)
    if save is not None:
        if not Path(save).absolute().parent.is_dir():
            raise ValueError(f"sweep: save: there is no folder {str(Path(save).parent)!r}; make it first")
        if Path(save).is_dir():
            raise ValueError(f"sweep: save: {str(save)!r} is a folder; name a file in it")


def _parameters(grid: Mapping[str, Sequence[Any] | np.ndarray]) -> dict[str, np.ndarray]:
    if not isinstance(grid, Mapping) or not grid:
        raise TypeError(f"sweep: grid must map parameter names to values, got {grid!r}")
    return {name: _axis(name, given) for name, given in grid.items()}


def _axis(name: str, given: Sequence[Any] | np.ndarray) -> np.ndarray:
    """Return the values as an array: of numbers or texts where they are alike, else of objects."""
    if not isinstance(name, str):
        raise TypeError(f"sweep: parameter names must be texts, got {name!r}")
    if isinstance(given, str | bytes | Mapping | Set) or not isinstance(given, Iterable):
        raise TypeError(f"sweep: grid[{name!r}] must be a sequence of values, got {given!r}; write [{given!r}]")
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
                raise TypeError(f"the function returned {name} of type {type(value).__name__}; return numbers")
            values[name] = array.astype(float)
        return values
    except (Exception, SystemExit) as exception:
        return _message(exception)


def _message(exception: BaseException) -> str:
    return f"{type(exception).__name__}: {exception}"


def _through(
    executor: Executor,
    function: Callable[..., Any],
    todo: Iterable[GridPoint],
    window: int,
    lost: list[GridPoint] | None = None,
) -> Outcomes:
    """Yield outcomes as they come, with at most `window` points on their way.

    Points whose process died, or that were on their way when the process of another point died, are added to `lost`
    if that is given; else they count as failed.
    """
    finished: SimpleQueue[Future[Values | str]] = SimpleQueue()
    waiting: dict[Future[Values | str], GridPoint] = {}
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
            if lost is not None and _died(future.exception()):
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


def _died(exception: BaseException | None) -> bool:
    """Return whether the process of a point died: a broken pool, or what dask calls a killed worker."""
    if isinstance(exception, BrokenExecutor):
        return True
    kind = type(exception)
    return kind.__name__ == "KilledWorker" and kind.__module__.partition(".")[0] == "distributed"


def _elsewhere(executor: Executor, function: Callable[..., Any], todo: Iterator[GridPoint]) -> Outcomes:
    """Yield outcomes from an executor that is not ours.

    A point that kills its worker may take others with it: all of them are tried again, each alone.
    """
    lost: list[GridPoint] = []
    yield from _through(executor, function, todo, _WINDOW, lost)
    for task in lost:
        yield from _through(executor, function, [task], 1)


def _submit(executor: Executor, function: Callable[..., Any], point: Point) -> Future[Values | str]:
    try:
        return executor.submit(_evaluate, function, point)
    except BrokenExecutor as broken:
        future: Future[Values | str] = Future()
        future.set_exception(broken)
        return future


def _outcome(future: Future[Values | str]) -> Values | str:
    try:
        return future.result()
    except Exception as exception:
        return _message(exception)


def _own_processes(function: Callable[..., Any], todo: Iterator[GridPoint], workers: int) -> Outcomes:
    """Yield outcomes from processes of our own.

    A point that kills its process breaks the whole pool: the points then on their way are evaluated again
    one by one, which shows the culprit, before the others go on in a fresh pool.
    """
    # the points of a broken pool
    lost: list[GridPoint] = []

    def until_it_breaks(first: GridPoint) -> Iterator[GridPoint]:
        yield first
        while not lost and (task := next(todo, None)) is not None:
            yield task

    for task in todo:
        yield from _in_pool(function, until_it_breaks(task), workers, lost)
        while lost:
            yield from _in_pool(function, [lost.pop(0)], 1, None)


def _begin_worker() -> None:
    """Let a worker end without a traceback on Ctrl-C, and by itself when its parent has ended, for whatever reason."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent.sentinel,), daemon=True).start()


def _end_after(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


def _in_pool(
    function: Callable[..., Any], todo: Iterable[GridPoint], workers: int, lost: list[GridPoint] | None
) -> Outcomes:
    pool = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),  # safe with threads, and the same on every system
        initializer=_begin_worker,
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
