"""Matrix products on one thread.

BLAS shares a product among all cores. The products of a simulation are small and many: to wake other cores for each
costs more than they save, and several times as much where these cores are busy.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from functools import cache
from threading import Lock
from typing import Any

from stickslip.equations.system import System

_SMALL = 30  # states and rows up to which products are so small that BLAS seldom shares them


class _OneThread:
    """A context in which BLAS uses one thread; several may be inside at once, in several threads."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0
        self._limit: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._limit = _libraries().limit(limits=1)
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                self._limit.restore_original_limits()


_ONE_THREAD, _AS_EVER = _OneThread(), nullcontext()


def one_thread(system: System, always: bool = False) -> AbstractContextManager[None]:
    """Return the context for products of a system: BLAS keeps to one thread, for small ones only if `always`."""
    return _ONE_THREAD if always or system.size + system.m > _SMALL else _AS_EVER


@cache
def _libraries() -> Any:
    """The BLAS libraries of this process; looking for them takes some milliseconds."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")
