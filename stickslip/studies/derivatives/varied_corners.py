"""How the time changes at which a motion comes to the corner of a table."""

from __future__ import annotations

import numpy as np

from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array
from stickslip.studies.derivatives.nearby import Nearby
from stickslip.studies.derivatives.varied_guards import TIE

# An argument of a table grazes a corner if, at its speed there, it would change over the whole motion by less than this
# part of its size.
_GRAZING_CHANGE = 1e-9


def corner_times(
    nearby: Nearby, number: int, motion: Motion, S: Array, since: Array
) -> tuple[Array, dict[int, str]] | None:
    """Return the changes ``-(x_p + x_y S) / x'`` of the time at which a motion leaves the regions of tables.

    `x` is the argument of a table less its corner. A second value holds the reasons why some do not exist, by
    direction. None is returned where no table leaves its region.
    """
    regions = motion.table_regions
    following = nearby.motion_of(number + 1).table_regions
    left = [(k, a, b) for k, (a, b) in enumerate(zip(regions or (), following or (), strict=True)) if a != b]
    if not left:
        return None
    path = nearby.trajectory.pieces[number].kept_path
    tau, y = float(path.taus[-1]), path.last

    def beyond(own: Motion, taus: Array, states: Array) -> Array:
        dependence, x = own.system.dependence, own.looked_up(taus, states)
        assert dependence is not None
        return np.array([x[k] - dependence.borders(k, a)[int(b > a)] for k, a, b in left])

    size = np.abs(beyond(motion, path.taus, path.points.T)).max(axis=1)
    moved = nearby.slopes_at(beyond, motion, since, tau, y, S)
    falls = nearby.falls(beyond, motion, tau, y)
    if (np.abs(falls) * tau <= _GRAZING_CHANGE * size).any():
        why = "a table comes to its corner with slope 0"
        return np.full(nearby.count, np.nan), dict.fromkeys(range(nearby.count), why)
    times = -moved / falls[:, None]
    apart = (np.abs(times - times[0]) > TIE * np.abs(times).max(axis=0)).any(axis=0)
    found = np.where(apart, np.nan, times[0])
    return found, dict.fromkeys(apart.nonzero()[0].tolist(), "corners of several tables fall together")
