"""What fails within a sparse solver of SUNDIALS waits until the solver may be left."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from stickslip.model.arrays import Array


class Faults:
    """Exceptions from the functions that a solver calls; they wait if it is sparse.

    A sparse solver may be left by an exception from its rates or residual only, and only once it has had a Jacobian:
    else it frees what it does not have, and the process ends.
    """

    def __init__(self, waits: bool) -> None:
        self._waits = waits
        self._first: Exception | None = None
        self._has_jacobian = False

    def clear(self) -> None:
        """Forget what has failed: the solver is used again."""
        self._first = None

    def check(self) -> None:
        """Raise what has failed."""
        if self._first is not None:
            raise self._first

    def of_rates(self, function: Callable[..., None]) -> Callable[..., None]:
        """Return a function that fills its last argument as the given one does, but raises later."""
        if not self._waits:
            return function

        @wraps(function)
        def shielded(*arguments: Any) -> None:
            if self._first is None:
                try:
                    function(*arguments)
                    return
                except Exception as fault:
                    self._first = fault
            arguments[-1][:] = 0.0
            if self._has_jacobian:
                self.check()

        return shielded

    def of_jacobian(self, function: Callable[..., None], instead: Callable[[], float | Array]) -> Callable[..., None]:
        """Return a function that fills its last argument as the given one does, or else `instead`: the rates raise."""
        if not self._waits:
            return function

        @wraps(function)
        def shielded(*arguments: Any) -> None:
            try:
                function(*arguments)
            except Exception as fault:
                self._first = self._first or fault
                arguments[-1][:] = instead()
            self._has_jacobian = True

        return shielded
