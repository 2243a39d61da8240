"""Sines that act on the bodies, rows or drives of a scene that is followed part by part."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy

from stickslip.equations.forest import spans
from stickslip.equations.loads.sines import NO_SINES, Sines
from stickslip.model.arrays import Array, Indices, Mask


@dataclass(frozen=True)
class SineShares:
    """What sines add to each of many things (bodies, rows or drives).

    The sines of thing i stand from ``firsts[i]`` on, with their `shares`. With `since`, their integrals from that time
    on are added instead.
    """

    sines: Sines
    firsts: Indices
    shares: Array
    since: float | None = None

    @classmethod
    def of(cls, sines: Sines, acts: Any, since: float | None = None) -> SineShares:
        """Return shares from a matrix with a row for each thing and a column for each sine."""
        acts = scipy.sparse.csr_array(acts)
        return cls(sines.some(acts.indices), acts.indptr.astype(np.intp), acts.data, since)

    @classmethod
    def none(cls, count: int) -> SineShares:
        """Return the shares of so many things without sines."""
        return cls(NO_SINES, np.zeros(count + 1, dtype=np.intp), np.empty(0))

    @classmethod
    def among(cls, sines: Sines, things: Indices, count: int) -> SineShares:
        """Return shares where sine k is a part of thing ``things[k]``; leave out numbers beyond the `count` things."""
        own = ((things >= 0) & (things < count)).nonzero()[0]
        if not own.size:
            return cls.none(count)
        acts = scipy.sparse.csr_array((np.ones(own.size), (things[own], own)), shape=(count, things.size))
        return cls.of(sines, acts)

    @cached_property
    def has_any(self) -> bool:
        """Whether any thing has sines."""
        return self.shares.size > 0

    @cached_property
    def have_sines(self) -> Mask:
        """Which things have sines."""
        return np.asarray(np.diff(self.firsts) > 0)

    @property
    def sizes(self) -> Array:
        """The sums of the amplitudes of all things."""
        return self._sums(self.sines.amplitude)

    @cached_property
    def rate_sizes(self) -> Array:
        """The same of the rates."""
        return self._sums(self.sines.turn * self.sines.amplitude)

    def _sums(self, sizes: Array) -> Array:
        """Return the sums of the shares of things in sines of some sizes."""
        own = np.repeat(np.arange(self.firsts.size - 1), np.diff(self.firsts))
        return np.asarray(np.bincount(own, np.abs(self.shares * sizes), self.firsts.size - 1), dtype=float)

    def series(self, things: Indices, t: float, terms: int, unit: float) -> Array:
        """Return what sines add to some things from time `t` on: Taylor coefficients over `unit`, a row for each."""
        found = np.zeros((things.size, terms))
        places = spans(self.firsts, things)
        if places.size:
            own = np.repeat(np.arange(things.size), self.firsts[things + 1] - self.firsts[things])
            sines = self.sines.some(places)
            series = (
                sines.taylor(t, terms - 1, unit)
                if self.since is None
                else sines.taylor_of_integrals(self.since, t, terms - 1, unit)
            )
            np.add.at(found, own, self.shares[places, None] * series.T)
        return found


@dataclass(frozen=True)
class LinesWithSines:
    """Series of things that are straight but for sines, from any time on: in powers of the time over `unit`."""

    straight: Array  # (k, 2): values and slopes at `start`
    start: float
    sines: SineShares
    unit: float
    terms: int  # of each series where there are sines; lines have two

    def __call__(self, things: Indices, t: float) -> Array:
        """Return the series of some things from time `t` on, a row for each."""
        found = self.straight[things]
        found[:, 0] += (t - self.start) * found[:, 1]
        found[:, 1] *= self.unit
        if not self.sines.has_any:
            return found
        both = self.sines.series(things, t, self.terms, self.unit)
        both[:, :2] += found
        return both
