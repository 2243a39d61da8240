"""Runs in a row, read as one: gear shifts, supervisory logic, restarts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip.model.scene import Scene
from stickslip.simulation.result import Event, Result

__all__ = ["Joined", "join"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Joined:
    """Results of runs in a row; each quantity is read by name as of a single one.

    What a run does not know (a body that only another scene has) is NaN in its part.

    Attributes
    ----------
    results : tuple of Result
        In order of time.
    """

    results: tuple[Result, ...] = field(repr=False)

    @property
    def t(self) -> Array:
        """Times in s; where one run ends and the next begins stand two."""
        return np.concatenate([result.t for result in self.results])

    @property
    def events(self) -> list[Event]:
        """All events in order of time."""
        return [event for result in self.results for event in result.events]

    @property
    def success(self) -> bool:
        """Whether every run reached its end."""
        return all(result.success for result in self.results)

    @property
    def scene(self) -> Scene:
        """The scene of the last run."""
        return self.results[-1].scene

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive at the times `t`, in m/s or rad/s."""
        return self._read(lambda result: result.velocity(body))

    def position(self, body: str) -> Array:
        """Return the position of a body or drive at the times `t`, in m or rad."""
        return self._read(lambda result: result.position(body))

    def force(self, contact: str) -> Array:
        """Return the force of a contact or another row at the times `t`, in N or N m."""
        return self._read(lambda result: result.force(contact))

    def normal(self, contact: str) -> Array:
        """Return the normal force of a contact at the times `t`, in N."""
        return self._read(lambda result: result.normal(contact))

    def relative_velocity(self, contact: str) -> Array:
        """Return the relative velocity of a row at the times `t`, in m/s or rad/s."""
        return self._read(lambda result: result.relative_velocity(contact))

    def power(self, contact: str) -> Array:
        """Return the power that a contact turns into heat at the times `t`, in W."""
        return self._read(lambda result: result.power(contact))

    def mode(self, contact: str) -> Array:
        """Return the mode of a row at the times `t`: -1, 0 or +1."""
        return self._read(lambda result: result.mode(contact).astype(float))

    def state(self, block: str) -> Array:
        """Return the state of a block at the times `t`."""
        return self._read(lambda result: result.state(block))

    def output(self, block: str) -> Array:
        """Return the output of a block at the times `t`."""
        return self._read(lambda result: result.output(block))

    def final_scene(self) -> Scene:
        """Return the scene at the end of the last run."""
        return self.results[-1].final_scene()

    def _read(self, read: Callable[[Result], Array]) -> Array:
        found: list[Array | None] = []
        fault: ValueError | None = None
        for result in self.results:
            try:
                found.append(read(result))
            except ValueError as error:
                found.append(None)
                fault = error
        known = [part for part in found if part is not None]
        if not known:
            assert fault is not None
            raise fault
        shape = known[0].shape[:-1]
        parts = [
            np.full((*shape, result.t.size), np.nan) if part is None else part
            for part, result in zip(found, self.results, strict=True)
        ]
        return np.concatenate(parts, axis=-1)


def join(results: Sequence[Result]) -> Joined:
    """Return the results of runs in a row as one.

    Parameters
    ----------
    results : sequence of Result
        Each begins where the one before ends, from its `final_scene` or any other scene.

    Raises
    ------
    TypeError, ValueError
        If there is none, one is no result, or one does not begin where the one before has ended.
    """
    if not isinstance(results, Iterable):
        raise TypeError(f"join: expected a list of results, got {results!r}")
    listed = tuple(results)
    if not listed:
        raise ValueError("join: there are no results; give at least one")
    for number, result in enumerate(listed):
        if not isinstance(result, Result):
            raise TypeError(f"join: expected results, got {result!r}")
        if not number:
            continue
        end = float(listed[number - 1].trajectory.stops[-1])
        start = float(result.trajectory.starts[0])
        if abs(start - end) > 1e-9 * max(abs(start), abs(end)):
            raise ValueError(
                f"join: run {number + 1} begins at {start:g} s, but the one before ends at {end:g} s; "
                "give runs in order of time, without gaps"
            )
    return Joined(listed)
