"""Karnopp's dead bands along a run: a contact that has left rest sticks again only after it has left its band, too."""

from __future__ import annotations

import numpy as np

from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes
from stickslip.simulation.signs import DEGREE


def until_out_of_bands(motion: Motion, guards: Guards, path: Path) -> Path:
    """Return the path up to where the first row is seen out of the dead band in which it starts.

    The exact time does not matter: from then on the edge of the band is a guard. Fixed steps end there by themselves,
    as at other changes.
    """
    if not guards.in_band.size or path.taus.size < 2 or motion.segment.is_stepped:
        return path
    taus = (path.taus[:-1, None] + np.diff(path.taus)[:, None] * chebyshev_nodes(DEGREE)).ravel()
    out = (guards.beyond_bands(taus, path.at(taus).T) > 0).any(axis=0)
    found = float(taus[out.argmax()])
    return motion.until(path, found) if out.any() and 0 < found < path.taus[-1] else path
