"""How many small and large slips does a fault have? A catalogue of events, as seismologists make one.

Carlson and Langer (1989) pulled a row of blocks over rough ground and counted the events that are larger than a
magnitude, the logarithm of the slip summed over the blocks. Their friction falls with velocity. Here it drops when a
block lets go, and the levels differ at random: the slope is not theirs, but many events are small, and few run far.
100 blocks take about 3 s. `earthquake_statistics.py FIGURE 1000 20000` pulls 1000 blocks for 20,000 s.
"""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Mode, Scene, Spring, simulate

FIGURE = Path(__file__).parent / "figures" / "earthquake_statistics.png"
AT_ONCE = 200


def main(figure: Path, blocks: int = 100, stop: float = 2000.0) -> None:
    """Pull the fault, list its catalogue and draw how many events are larger than each magnitude."""
    names = [f"b{i}" for i in range(blocks)]
    levels = np.random.default_rng(2000).uniform(0.5, 1.5, blocks)
    scene = Scene(
        Drive("plate", velocity=1e-3, position=0.49),
        *(Body(name, inertia=1.0) for name in names),
        *(Spring("plate", name, stiffness=1.0, damping=0.3) for name in names),
        *(Spring(a, b, stiffness=1.0) for a, b in pairwise(names)),
        *(Contact(n, n, GROUND, DryFriction(1.0, 0.8), normal=N) for n, N in zip(names, levels, strict=True)),
    )
    result = simulate(scene, (0.0, stop))
    moving, first, spans = 0, 0.0, []
    for event in result.events:
        if event.before == Mode.STUCK:
            first, moving = (first if moving else event.t), moving + 1
        elif event.after == Mode.STUCK:
            moving -= 1
            if not moving:
                spans.append((first, event.t))
    slips = []
    for k in range(0, len(spans), AT_ONCE):
        starts, ends = np.array(spans[k : k + AT_ONCE]).T
        slips += (result(ends) - result(starts))[blocks : 2 * blocks].sum(axis=0).tolist()  # positions
    magnitude, number = np.sort(np.log10(slips))[::-1], np.arange(1, len(slips) + 1)
    slope = np.polyfit(magnitude[len(slips) // 4 :], np.log10(number[len(slips) // 4 :]), 1)[0]
    print(
        f"{len(result.events)} changes of modes make {len(slips)} events; their number falls as slip^{slope:.2f}"
    )

    axes = (drawing := Figure(figsize=(7.0, 5.0), layout="constrained")).subplots()
    axes.loglog(10**magnitude, number, "k.", markersize=4)
    axes.set(xlabel="slip of an event, all blocks [m]", ylabel="number of events at least as large")
    drawing.savefig(figure, dpi=150)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE, *(int(x) for x in sys.argv[2:]))
