"""How many small and large slips does a fault have? A catalogue of events, as seismologists make one.

Carlson and Langer (1989) pulled a row of blocks over rough ground and counted the events that are larger than a
magnitude, the logarithm of the slip summed over the blocks. Their friction falls with velocity. Here it drops when a
block lets go, and the levels differ at random: the slope is not theirs, but many events are small, and few run far.
Neighbours that slip at the same time slip in one event. 100 blocks take 3 s; 1000 blocks for 10,000 s, 1.5 minutes.
"""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Mode, Scene, Spring, simulate

FIGURE = Path(__file__).parent / "figures" / "earthquake_statistics.png"


def main(figure: Path, blocks: int = 100, stop: float = 2000.0) -> None:
    """Pull the fault, list its catalogue and draw how many events are larger than each magnitude."""
    names = [f"{i}" for i in range(blocks)]
    levels = np.random.default_rng(2000).uniform(0.5, 1.5, blocks).tolist()
    scene = Scene(
        Drive("plate", velocity=1e-3, position=0.49),
        *(Body(name, inertia=1.0) for name in names),
        *(Spring("plate", name, stiffness=1.0, damping=0.3) for name in names),
        *(Spring(a, b, stiffness=1.0) for a, b in pairwise(names)),
        *(Contact(n, n, GROUND, DryFriction(1.0, 0.8), normal=N) for n, N in zip(names, levels, strict=True)),
    )
    result = simulate(scene, (0.0, stop))
    slips, lengths, links, moving = list[list[float]](), list[float](), [(0, 0)], dict[int, int]()
    for event in result.events:
        block = int(event.contact)
        if event.before == Mode.STUCK:
            links += [(moving[k], len(slips)) for k in (block - 1, block + 1) if k in moving]
            moving[block] = len(slips)
            slips.append([block, event.t, stop])
        elif event.after == Mode.STUCK:
            slips[moving.pop(block)][2] = event.t
    for some in np.array_split(slips, len(slips) // 200 + 1):
        row, place = blocks + some[:, 0].astype(int), np.arange(len(some))  # positions
        lengths += (result(some[:, 2])[row, place] - result(some[:, 1])[row, place]).tolist()
    graph = coo_array((np.ones(len(links)), np.transpose(links)), (len(slips), len(slips)))
    size = np.sort(np.bincount(connected_components(graph)[1], lengths))[::-1]
    x, y = np.log10([size, number := np.arange(size.size) + 1])[:, size.size // 4 :]
    fall = f"these fall as slip^{np.polyfit(x, y, 1)[0]:.2f}"
    print(f"{len(result.events)} changes of modes make {size.size} events: {fall}")
    axes = (drawing := Figure(figsize=(7.0, 5.0), layout="constrained")).subplots()
    axes.loglog(size, number, "k.", markersize=4)
    axes.set(xlabel="slip of an event, all blocks [m]", ylabel="number of events at least as large")
    drawing.savefig(figure, dpi=150)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else FIGURE, *map(int, sys.argv[2:]))
