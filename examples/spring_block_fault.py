"""Fifty blocks on rough ground, coupled by springs and pulled by a slowly moving plate: a model of an earthquake fault.

Burridge and Knopoff (1967). The plate loads every block through a weak spring; a block that lets go pushes its
neighbours, and a few or many go along. The friction levels differ slightly at random (fixed seed). The upper picture
shows which block slips when; the lower one the size of each event, the slip summed over all blocks until all rest.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Mode, Scene, Spring, plots, simulate

FIGURE = Path(__file__).parent / "figures" / "spring_block_fault.png"
BLOCKS, PLATE, STOP = 50, 0.01, 300.0


def main(figure: Path) -> None:
    """Pull the fault, list the largest events and draw them."""
    names = [f"b{i}" for i in range(1, BLOCKS + 1)]
    levels = np.random.default_rng(2000).uniform(0.95, 1.05, BLOCKS)
    scene = Scene(
        Drive("plate", velocity=PLATE),
        *(Body(name, inertia=1.0) for name in names),
        *(Spring("plate", name, stiffness=1.0, damping=0.4) for name in names),
        *(Spring(a, b, stiffness=10.0) for a, b in zip(names, names[1:], strict=False)),
        *(
            Contact(f"c{i}", name, GROUND, DryFriction(1.0, 0.8), normal=level)
            for i, (name, level) in enumerate(zip(names, levels, strict=True), 1)
        ),
    )
    result = simulate(scene, (0.0, STOP), rtol=1e-6, atol=1e-8)
    slipping, start, events = 0, 0.0, []
    for event in result.events:
        before = slipping
        slipping += (event.after != Mode.STUCK) - (event.before != Mode.STUCK)
        start = event.t if before == 0 else start
        if slipping == 0:
            places = result(np.array([start, event.t]))[BLOCKS:]
            events.append((start, float(np.diff(places[:BLOCKS]).sum())))
    times, sizes = np.array(events).T
    print(f"{len(result.events)} changes of mode in {len(events)} events")
    for k in np.argsort(sizes)[:-4:-1]:
        print(f"  at {times[k]:.6f} s: slip {sizes[k]:.6f} m summed over the blocks")

    drawing = Figure(figsize=(9.0, 6.5), layout="constrained")
    axes = drawing.subplots(2, 1, sharex=True, height_ratios=(2.4, 1.0))
    plots.modes(result, ax=axes[0]).set(ylabel="block", xlabel="", title="which block slips when")
    axes[1].stem(times, sizes, basefmt=" ", linefmt="k-", markerfmt="k.")
    axes[1].set(xlabel="time [s]", ylabel="size of event [m]", yscale="log")
    drawing.savefig(figure, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
