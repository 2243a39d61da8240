"""Rows run in a process of their own, so that one that hangs or crashes is a failed row and nothing else."""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any

from validation.rows import Outcome, Row, judge
from validation.tried import patience

_GRACE = 1.0  # time in s that a process has to end by itself


def run(
    rows: Sequence[Row], prepare: Callable[[], None] | None = None, jobs: int = 1
) -> Generator[Outcome, None, None]:
    """Yield the outcome of each row, in their order: so many `jobs` run side by side, each in a process of its own.

    The functions of the rows must be importable there; `prepare` is called first in each.
    """
    idle: SimpleQueue[_Worker] = SimpleQueue()
    workers = [_Worker(prepare) for _ in range(jobs)]
    for worker in workers:
        idle.put(worker)

    def judged(row: Row) -> Outcome:
        worker = idle.get()
        try:
            return worker.judge(row)
        finally:
            idle.put(worker)

    with ThreadPoolExecutor(jobs) as threads:
        try:
            yield from threads.map(judged, rows)
        finally:
            threads.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.stop()


class _Worker:
    """A process that runs rows, one after another; a new one takes its place where it ends or hangs."""

    def __init__(self, prepare: Callable[[], None] | None) -> None:
        self._prepare, self._stopped = prepare, False
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._line, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, self._prepare), daemon=True)
        self._process.start()
        other.close()
        self._ready = False

    def judge(self, row: Row) -> Outcome:
        """Return the outcome of a row, a failure where the process ends or its time limit passes."""
        start = time.perf_counter()
        try:
            if not self._ready:
                refusal = self._line.recv()
                if refusal:
                    return Outcome(row, math.inf, 0.0, refusal)
                self._ready, start = True, time.perf_counter()
            self._line.send(row)
            if self._line.poll(row.limit * patience()):
                error, seconds, remark, tried = self._line.recv()
                return Outcome(row, error, seconds, remark, tried)
            outcome = Outcome(row, math.inf, row.limit, f"no answer within {row.limit:g} s")
        except (EOFError, OSError):
            self._process.join()
            remark = f"the process ended with code {self._process.exitcode}"
            outcome = Outcome(row, math.inf, time.perf_counter() - start, remark)
        if not self._stopped:
            self._end()
            self._start()
        return outcome

    def stop(self) -> None:
        """End the process for good."""
        self._stopped = True
        self._end()

    def _end(self) -> None:
        # a process that waits for rows ends by itself, and tidies up
        self._line.close()
        self._process.join(_GRACE)
        self._process.kill()
        self._process.join()


def _serve(line: Connection, prepare: Callable[[], None] | None) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # output that solvers print from C does not belong in the table
        os.dup2(nowhere, stream)
    try:
        if prepare is not None:
            prepare()
    except Exception as fault:
        line.send(f"{type(fault).__name__}: {fault}")
        return
    line.send("")
    while True:
        try:
            row: Any = line.recv()
        except (EOFError, KeyboardInterrupt):
            return
        outcome = judge(row)
        line.send((outcome.error, outcome.seconds, outcome.remark, outcome.tried))
