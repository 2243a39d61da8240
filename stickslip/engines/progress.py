"""Watch the steps of a solver: give up where the end is out of reach; after Ctrl-C keep what was computed."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, Self

_CALLS_BETWEEN_LOOKS, CALLS_AT_MOST = 50_000, 1e9
_CALLS_BETWEEN_SIGNS, _CALLS_AFTER_INTERRUPTION = 500, 10_000


class OutOfReach(ArithmeticError):
    """The steps have become so small that the end is out of reach."""

    remedy = (
        "loosen rtol if it asks for more than roundoff leaves of small velocities beside stiff springs far from 0, "
        "else look at the loads and laws of the scene there"
    )


class Interruption:
    """Records whether Ctrl-C has been pressed since the context was entered.

    An exception that leaves a solver's callback loses all computed points. So the first press only sets `pressed`,
    and the second raises KeyboardInterrupt. Where the program handles the signal itself, or in another than the main
    thread, nothing is changed.

    Engines call `show` with the local time in s now and then, for a progress bar.
    """

    def __init__(self) -> None:
        self.pressed = False
        self.show: Callable[[float], None] | None = None
        self._former: Any = None

    def __enter__(self) -> Self:
        """Take over the signal."""
        is_main = threading.current_thread() is threading.main_thread()
        if is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            self._former = signal.signal(signal.SIGINT, self._press)
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the former handler of the signal."""
        if self._former is not None:
            signal.signal(signal.SIGINT, self._former)
            self._former = None

    def _press(self, number: int, frame: FrameType | None) -> None:
        if self.pressed:
            signal.default_int_handler(number, frame)
        self.pressed = True


class Progress:
    """Counts the evaluations of one motion, remembers the last, and gives up where the end is out of reach.

    `whole` is the length of the motion in s, `last` the local time of the last evaluation. After Ctrl-C the guard
    function stops the solver; if that does not happen soon, KeyboardInterrupt is raised here.
    """

    def __init__(self, whole: float, interruption: Interruption) -> None:
        self._whole, self._interruption = whole, interruption
        self._calls, self._looked_at = 0, 0.0
        self.last = 0.0

    def note(self, tau: float) -> None:
        """Count an evaluation at local time `tau`.

        It is an error if the motion would take more than 1e9 evaluations at the pace of the last 50 000, or if the
        time is not a number: SUNDIALS' own tests let such steps pass, and the solver would never end.
        """
        if math.isnan(tau):
            raise ArithmeticError("the step has become not a number: forces or tolerances are out of proportion")
        self.last = tau
        self._calls += 1
        if self._calls % _CALLS_BETWEEN_SIGNS:
            return
        if self._interruption.show is not None:
            self._interruption.show(tau)
        if self._calls % _CALLS_BETWEEN_LOOKS == 0:
            self._look(tau)
        if self._interruption.pressed and self._calls % _CALLS_AFTER_INTERRUPTION == 0:
            raise KeyboardInterrupt

    def _look(self, tau: float) -> None:
        done = tau - self._looked_at
        if done * CALLS_AT_MOST < _CALLS_BETWEEN_LOOKS * self._whole:
            raise OutOfReach(
                f"the last {_CALLS_BETWEEN_LOOKS} evaluations took {done:.3g} s of {self._whole:.3g} s: "
                "the steps have become too small"
            )
        self._looked_at = tau
