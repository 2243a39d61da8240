"""Piecewise-linear functions of the state as matrices: values and borders of all regions, and where a state lies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.model.arrays import Array, Indices, Modes
from stickslip.model.elements.book import RowEntry

_NONE = np.empty(0, dtype=np.int16)
Regions = NDArray[np.int16]

# A state that lies beyond a border by up to this part of the border's majorant still counts as at the border.
_WITHIN = 1e-9


class PiecewiseMatrices:
    """The piecewise-linear functions of all p gaps and stops; their regions are listed function by function."""

    def __init__(
        self, rows: Mapping[int, RowEntry], acts: Any, values: tuple[Any, Any], borders: tuple[Any, Any]
    ) -> None:
        self.acts = acts  # (n, p): forces on the bodies from the values
        # (all regions, size), (all regions, inputs): values from states and inputs
        self.value_y, self.value_q = values
        # (borders, size), (borders, inputs): borders of all regions
        self.border_y, self.border_q = borders
        functions = list(rows.values())
        self.count = len(functions)
        self.labels = [f"{function.kind} {function.name!r}" for function in functions]
        regions = [region for function in functions for region in function.regions]
        sizes = [len(function.regions) for function in functions]
        # (p,): the place of each function's first region
        self.first = (np.cumsum([0, *sizes])[:-1] if sizes else np.empty(0)).astype(np.intp)
        self.mode = np.array([region.mode for region in regions], dtype=np.int8)  # what the row shows in each
        # (all regions, 3), (borders, 3): values and borders from the stretch, its rate and 1
        self.value = np.reshape([region.value for region in regions], (-1, 3))
        self.border = np.reshape([border for region in regions for border, _ in region.borders], (-1, 3))
        # the borders of region i are those from ``border_from[i]`` up to ``border_from[i + 1]``
        self.border_from = np.cumsum([0, *(len(region.borders) for region in regions)])
        self.row = np.array(list(rows), dtype=np.intp)  # (p,): the row that each belongs to
        # the function of a stop only shows at which limit it is; that of a gap is the force of its row
        self.is_stop = np.array([function.kind == "stop" for function in functions], dtype=bool)
        self.is_force = ~self.is_stop
        owners = np.repeat(np.arange(self.count), sizes)
        # (borders,): the region of each border, its function, and the number of the region beyond
        self.within = np.repeat(np.arange(len(regions)), [len(region.borders) for region in regions])
        self.owner = owners[self.within]
        beyond = [other for region in regions for _, other in region.borders]
        self.beyond = np.array(beyond, dtype=np.intp)
        self.abs_border_y, self.abs_border_q = abs(self.border_y), abs(self.border_q)

    def places(self, regions: Regions) -> Indices:
        """Return the places of one region of each function among all regions."""
        return np.asarray(self.first + regions)

    def among(self, rows: slice) -> slice:
        """Return which functions belong to rows from one up to another."""
        return slice(*self.row.searchsorted([rows.start or 0, rows.stop or np.iinfo(np.intp).max]).tolist())

    def borders_of(self, regions: Regions) -> Indices:
        """Return the borders of one region of each function."""
        return np.asarray((self.places(regions)[self.owner] == self.within).nonzero()[0])

    def at(self, y: Array, q: Array, regions: Regions | None) -> Regions:
        """Return the regions in which a state lies; those given are kept where it lies within or at their borders."""
        if not self.count:
            return _NONE
        q = q[: self.border_q.shape[1]]
        depth = self.border_y @ y + self.border_q @ q
        size = self.abs_border_y @ np.abs(y) + self.abs_border_q @ np.abs(q)
        outside = depth < -_WITHIN * size
        found = np.zeros(self.count, dtype=np.int16) if regions is None else regions.copy()
        left = np.zeros(self.count, dtype=bool)
        left[self.owner[outside & (self.places(found)[self.owner] == self.within)]] = True
        for k in left.nonzero()[0].tolist():
            own = (self.owner == k).nonzero()[0]
            last = int(self.within[own].max()) + 1
            part = np.divide(depth[own], size[own], out=np.zeros(own.size), where=size[own] > 0)
            least = np.full(last - self.first[k], np.inf)
            np.minimum.at(least, self.within[own] - self.first[k], part)
            # the region in which the state lies deepest
            found[k] = int(least.argmax())
        return found

    def limits(self, y: Array, q: Array, largest: Array) -> tuple[Array, Array, Array]:
        """Return how far each stop is from its upper and from its lower limit, and the majorant at the nearer one.

        Distances are infinite where there is no limit; a line per function. `largest` are bounds of the states' sizes.
        """
        q = q[: self.border_q.shape[1]]
        depth = self.border_y @ y + self.border_q @ q
        size = self.abs_border_y @ np.maximum(np.abs(y), np.abs(largest)) + self.abs_border_q @ np.abs(q)
        # (2, functions): the upper and the lower side
        distances, sizes = np.full((2, self.count), np.inf), np.zeros((2, self.count))
        for side in (0, 1):
            some = self.is_stop[self.owner] & (self.beyond == side + 1)
            distances[side, self.owner[some]], sizes[side, self.owner[some]] = depth[some], size[some]
        upper, lower = distances
        return upper, lower, np.where(upper < lower, sizes[0], sizes[1])

    def shown(self, labels: Modes, regions: Regions) -> Modes:
        """Return the modes that rows show: `labels`, but of gaps and stops what their regions show."""
        labels = labels.copy()
        labels[self.row] = self.mode[self.places(regions)]
        return labels

    def widest(self, links: Any) -> Any:
        """Return bounds of the sizes of the map from states to forces: of `links` and, in any region, gaps."""
        if not self.count:
            return abs(links)
        # the largest size of each entry among the regions of a function
        values = scipy.sparse.coo_array(abs(self.value_y))
        owner = self.first.searchsorted(values.row, side="right") - 1
        width = values.shape[1]
        keys, place = np.unique(owner * width + values.col, return_inverse=True)
        largest = np.zeros(keys.size)
        np.maximum.at(largest, place, values.data)
        steepest = scipy.sparse.csr_array((largest, (keys // width, keys % width)), (self.count, width))
        return abs(links) + abs(self.acts) @ steepest
