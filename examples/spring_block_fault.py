"""Fifty blocks on rough ground, coupled by springs and pulled by a slowly moving plate: a model of an earthquake fault.

Burridge and Knopoff (1967). The plate loads every block through a weak spring; a block that lets go pushes its
neighbours, and a few or many go along: an event, until all rest. The friction levels differ at random by a fifth (fixed
seed). Above: which block slips when. Below: the slip of each event, summed over all blocks. It takes about 3 s.
"""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Mode, Scene, Spring, simulate

FIGURE = Path(__file__).parent / "figures" / "spring_block_fault.png"
BLOCKS, PLATE, STOP = 50, 2e-4, 1500.0


def main(figure: Path) -> None:
    """Pull the fault, list the largest events and draw them."""
    names = [f"b{i}" for i in range(BLOCKS)]
    levels = np.random.default_rng(2000).uniform(0.8, 1.2, BLOCKS)
    scene = Scene(
        Drive("plate", velocity=PLATE, position=0.75),
        *(Body(name, inertia=1.0) for name in names),
        *(Spring("plate", name, stiffness=1.0, damping=0.3) for name in names),
        *(Spring(a, b, stiffness=3.0) for a, b in pairwise(names)),
        *(Contact(n, n, GROUND, DryFriction(1.0, 0.8), normal=N) for n, N in zip(names, levels, strict=True)),
    )
    result = simulate(scene, (0.0, STOP), rtol=1e-6, atol=1e-8)
    slips, sizes, since, first = [], [], dict[str, float](), 0.0
    for event in result.events:
        if event.after == Mode.STUCK:
            slips.append((names.index(event.contact), since.pop(event.contact), event.t))
            if not since:
                moved = result(event.t) - result(first)  # velocities, then positions
                sizes.append((first, float(moved[BLOCKS : 2 * BLOCKS].sum())))
        else:
            first = first if since else event.t
            since[event.contact] = event.t
    times, slip = np.array(sizes).T
    print(f"{len(slips)} slips of blocks make {len(times)} events")
    for k in np.argsort(slip)[:-4:-1]:
        print(f"  at {times[k]:.6f} s: slip {slip[k]:.6f} m summed over the blocks")

    drawing = Figure(figsize=(9.0, 6.5), layout="constrained")
    above, below = drawing.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    above.hlines(*np.array(slips).T, color="k", linewidth=4)
    above.plot([start for _, start, _ in slips], [block for block, _, _ in slips], "ks", markersize=4)
    above.set(ylabel="number of the block", title="which block slips when")
    below.stem(times, slip, basefmt=" ", linefmt="k-", markerfmt="k.")
    below.set(xlabel="time [s]", ylabel="slip of an event,\nall blocks [m]", yscale="log", xlim=(0.0, STOP))
    drawing.savefig(figure, dpi=300)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
