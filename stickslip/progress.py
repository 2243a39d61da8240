"""A watch on the steps of a solver: an answer that never comes is none."""

from __future__ import annotations

__all__ = ["Progress"]

_CALLS_BETWEEN_LOOKS, _CALLS_AT_MOST = 50_000, 1e9


class Progress:
    """Counts the evaluations of one segment, remembers the last, and gives up where the end is out of reach.

    Parameters
    ----------
    whole : float
        Length of the segment in s.

    Attributes
    ----------
    last : float
        Local time in s of the last evaluation.
    """

    def __init__(self, whole: float) -> None:
        self._whole, self._calls, self._looked_at = whole, 0, 0.0
        self.last = 0.0

    def note(self, tau: float) -> None:
        """Count an evaluation at local time `tau`.

        Raises
        ------
        ArithmeticError
            If the segment would take more than 1e9 evaluations at the pace of the last 50 000.
        """
        self.last = tau
        self._calls += 1
        if self._calls % _CALLS_BETWEEN_LOOKS:
            return
        done = tau - self._looked_at
        if done * _CALLS_AT_MOST < _CALLS_BETWEEN_LOOKS * self._whole:
            raise ArithmeticError(
                f"the last {_CALLS_BETWEEN_LOOKS} evaluations took {done:.3g} s of {self._whole:.3g} s: "
                "the steps have become too small"
            )
        self._looked_at = tau
