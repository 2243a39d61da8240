"""Results from files."""

from __future__ import annotations

from collections.abc import Sequence

from stickslip.model.scene import Scene
from stickslip.results import files
from stickslip.results.outcome import Target
from stickslip.simulation.joined import Joined
from stickslip.simulation.result import Result


def load(path: Target, scene: Scene | Sequence[Scene] | None = None) -> Result | Joined:
    """Return the result that `save` wrote: the same numbers, and those between its times.

    Parameters
    ----------
    path : path
    scene : Scene, or sequence of Scene, optional
        The simulated scene, where its signals or laws are code that no file holds; of runs in a row the scene of each.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not such a file, or the scene is missing, or other names or sizes show that it is another one.
    """
    found = files.read(path, scene)
    results = [Result(**vars(run)) for run in (found if isinstance(found, list) else [found])]
    return Joined(tuple(results)) if isinstance(found, list) else results[0]
