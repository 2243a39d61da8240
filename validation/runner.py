"""Rows run in a process of their own, so that one that hangs or crashes is a failed row and nothing else."""

from __future__ import annotations

import math
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from typing import Any

from validation.rows import Outcome, Row, judge
from validation.tried import patience


def run(rows: Sequence[Row], prepare: Callable[[], None] | None = None) -> Iterator[Outcome]:
    """Yield the outcome of each row.

    Parameters
    ----------
    rows : sequence of Row
        What they check must be importable in another process.
    prepare : callable, optional
        Called first in the process that runs the rows.
    """
    worker = _Worker(prepare)
    try:
        for row in rows:
            outcome = worker.judge(row)
            if outcome is None:
                worker.stop()
                worker = _Worker(prepare)
                outcome = Outcome(row, math.inf, row.limit, f"no answer within {row.limit:g} s")
            yield outcome
    finally:
        worker.stop()


class _Worker:
    """The process that runs rows, one after another."""

    def __init__(self, prepare: Callable[[], None] | None) -> None:
        self._prepare = prepare
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._line, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, self._prepare), daemon=True)
        self._process.start()
        other.close()
        self._ready = False

    def judge(self, row: Row) -> Outcome | None:
        """Return the outcome, None where the time limit passed."""
        start = time.perf_counter()
        try:
            if not self._ready:
                refusal = self._line.recv()
                if refusal:
                    return Outcome(row, math.inf, 0.0, refusal)
                self._ready, start = True, time.perf_counter()
            self._line.send(row)
            if not self._line.poll(row.limit * patience()):
                return None
            error, seconds, remark, tried = self._line.recv()
        except (EOFError, ConnectionError):
            self._process.join()
            lived = time.perf_counter() - start
            remark = f"the process ended with code {self._process.exitcode}"
            self._start()
            return Outcome(row, math.inf, lived, remark)
        return Outcome(row, error, seconds, remark, tried)

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self._line.close()


def _serve(line: Connection, prepare: Callable[[], None] | None) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):  # what solvers print from C does not belong into the table
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
        outcome = judge(row, time.perf_counter)
        line.send((outcome.error, outcome.seconds, outcome.remark, outcome.tried))
