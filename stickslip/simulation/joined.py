"""Runs in a row, read as one: gear shifts, supervisory logic, restarts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.model.scene import Scene
from stickslip.results import files
from stickslip.results.files import Target
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

    def sample(self, times: int | Sequence[float] | Array) -> Joined:
        """Return the same runs at other times; where one ends and the next begins, the next one's.

        Parameters
        ----------
        times : int or array (k,)
            Increasing times in s within the runs, or how many evenly spaced ones.

        Raises
        ------
        ValueError, TypeError
            If a time lies outside, the times do not increase, or only the requested outputs were kept.
        """
        starts = [float(result.trajectory.starts[0]) for result in self.results]
        stop = float(self.results[-1].trajectory.stops[-1])
        if isinstance(times, (int, np.integer)) and not isinstance(times, bool):
            if times < 2:
                raise ValueError(f"sample: give at least 2 times, got {times}")
            times = np.linspace(starts[0], stop, int(times))
        wanted = np.asarray(times, dtype=float)
        if wanted.ndim != 1 or np.any(np.diff(wanted) < 0):
            raise ValueError("sample: give increasing times in one line, or how many")
        if wanted.size and not (starts[0] <= wanted[0] and wanted[-1] <= stop):
            raise ValueError(
                f"times must lie in [{starts[0]:g}, {stop:g}] s, got {wanted[0]:g} to {wanted[-1]:g}"
            )
        cuts = np.searchsorted(wanted, starts[1:])
        parts = np.split(wanted, cuts)
        # runs without a time stay, so that heat and work are counted through all of them
        return Joined(tuple(result.sample(part) for result, part in zip(self.results, parts, strict=True)))

    def to_csv(self, path: Target, *, units: bool | None = None) -> None:
        """Write all runs as one table, a line per time, as `Result.to_csv` does for one of them.

        Heat and work are counted from the start of the first run. What a run does not know is nan.

        Parameters
        ----------
        path : path
        units : bool, optional
            Whether the heads of the columns say the units; by default where the last scene says whether it rotates.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        known: dict[str, str] = {}
        for result in self.results:
            known |= files.column_units(result)
        with_units = None not in self.scene.motions.values() if units is None else units
        files.write_columns(self._columns(), path, known if with_units else {})

    def _columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of all runs, one after another; heat and work go on from run to run."""
        parts = [files.columns(result) for result in self.results]
        ends = [
            files.columns(result.sample(result.trajectory.stops[-1:])) if result.trajectory.is_dense else {}
            for result in self.results
        ]
        names = list(dict.fromkeys(name for part in parts for name in part))
        found = {}
        for name in names:
            so_far, pieces = 0.0, []
            counted = name.startswith(("heat ", "work "))
            for result, part, end in zip(self.results, parts, ends, strict=True):
                piece = part.get(name)
                pieces.append(np.full(result.t.size, np.nan) if piece is None else piece)
                if counted and piece is not None:
                    pieces[-1] = piece + so_far
                    so_far += float(end[name][0]) if name in end else 0.0
            found[name] = np.concatenate(pieces)
        return found

    def __str__(self) -> str:
        """Return when the runs begin and end, and their events."""
        spans = [
            f"{result.trajectory.starts[0]:g} to {result.trajectory.stops[-1]:g} s: {result.message}"
            for result in self.results
        ]
        return "\n".join([*spans, *map(str, self.events)])

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
