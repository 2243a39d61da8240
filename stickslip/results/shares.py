"""The part of the time that a contact spends in each mode."""

from __future__ import annotations

import numpy as np

from stickslip.equations.mode_equations import FREE
from stickslip.model.modes import Mode
from stickslip.results.in_a_row import of_each
from stickslip.results.readable import Readable
from stickslip.results.samples import Samples
from stickslip.results.trajectory import NOTHING_KEPT

_OF_CONTACTS = (Mode.BACKWARD, Mode.STUCK, Mode.FORWARD)
_OF_GAPS = (Mode.BACKWARD, Mode.OPEN, Mode.FORWARD)

# A smooth law has no events where the velocity changes its sign: each step is cut into this many parts instead.
_PARTS = 32


def share(result: Readable, contact: str) -> dict[Mode, float]:
    """Return the part of the simulated time that a contact spends in each mode; together they are 1.

    Exact where events separate the modes; where a law is smooth, the sign of the velocity is looked at 32 times in
    each step. Of runs in a row, only the time of those that have the contact is counted. If no time has passed, it is 1
    for the mode at that instant.

    Raises
    ------
    ValueError
        If there is no such contact, or the motion between the outputs was not kept.
    """
    places = of_each(result.runs, lambda samples: samples.row(contact))
    known = [run.samples for run, place in zip(result.runs, places, strict=True) if place is not None]
    times: dict[Mode, float] = {}
    for samples in known:
        for mode, time in _times(samples, contact).items():
            times[mode] = times.get(mode, 0.0) + time
    if not (total := sum(times.values())):
        return _at_start(known[0], contact)
    return {mode: time / total for mode, time in times.items()}


def _at_start(samples: Samples, row: str) -> dict[Mode, float]:
    """Return 1 for the mode of a row at the start, 0 for the others."""
    trajectory = samples.trajectory
    mode = Samples.at_times(trajectory, trajectory.starts[:1]).mode(row)[0]
    return {one: float(one == mode) for one in _modes(samples, row)}


def _modes(samples: Samples, row: str) -> tuple[Mode, ...]:
    """Return the modes that a row may be in."""
    return _OF_GAPS if samples.system.rows[samples.row(row)].kind in ("gap", "stop") else _OF_CONTACTS


def _times(samples: Samples, row: str) -> dict[Mode, float]:
    """Return how long a row is in each mode."""
    trajectory, j = samples.trajectory, samples.row(row)
    times = dict.fromkeys(_modes(samples, row), 0.0)
    if not trajectory.pieces:
        raise ValueError(f"share of {row!r}: {NOTHING_KEPT}")
    if not trajectory.is_dense:
        raise ValueError(
            f"share of {row!r}: the motion between the outputs was not kept; simulate with dense_output=True"
        )
    starts = trajectory.starts
    (inner,), (shown,) = trajectory.modes(np.arange(starts.size), np.zeros(starts.size), slice(j, j + 1))
    durations = np.where(inner == FREE, 0.0, trajectory.stops - starts)
    for mode in times:
        times[mode] = float(durations[shown == mode].sum())
    for number in (inner == FREE).nonzero()[0].tolist():
        path = trajectory.pieces[number].kept_path
        parts = np.linspace(path.taus[:-1], path.taus[1:], _PARTS + 1, axis=1)
        middles = 0.5 * (parts[:, 1:] + parts[:, :-1]).ravel()
        at = Samples.at_local(trajectory, np.full(middles.size, number, dtype=np.intp), middles)
        lengths = np.diff(parts, axis=1).ravel()
        for mode in times:
            times[mode] += float(lengths[at.mode(row) == mode].sum())
    return times
