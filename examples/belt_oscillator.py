"""A block on a moving belt, held by a spring: the stick-slip oscillator of Leine et al. (1998), from three starts.

Friction falls with speed, mu(v) = 1 / (1 + 3 v), a curve given as a Python function. Every start ends on the same
limit cycle: the block rides with the belt (flat top), breaks away where the spring is as strong as static friction,
swings back, and is caught again. The figure shows the phase plane, and the friction force against relative velocity.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip import Body, Contact, Drive, DryFriction, Scene, Spring, plots, simulate

FIGURE = Path(__file__).parent / "figures" / "belt_oscillator.png"
BELT = 0.2


def kinetic(speed: float) -> float:
    """Return the kinetic coefficient at a relative speed in m/s."""
    return 1.0 / (1.0 + 3.0 * speed)


def main(figure: Path) -> None:
    """Follow three starts to the limit cycle and draw them."""
    drawing = Figure(figsize=(10.0, 4.4), layout="constrained")
    left, right = drawing.subplots(1, 2, width_ratios=(1.25, 1.0))
    starts = {"from rest": (0.0, 0.0), "from far out": (2.2, 0.0), "from near the fixed point": (0.68, 0.0)}
    looks = zip(starts.items(), ("-", "--", ":"), ("#000000", "#0072B2", "#D55E00"), strict=True)
    for (name, (position, velocity)), style, colour in looks:
        scene = Scene(
            Body("block", inertia=1.0, position=position, velocity=velocity),
            Drive("belt", velocity=BELT),
            Spring("block", "ground", stiffness=1.0),
            Contact("surface", "block", "belt", DryFriction(1.0, 0.4, kinetic=kinetic), normal=1.0),
            motion="translation",
        )
        result = simulate(scene, (0.0, 60.0), t_eval=np.linspace(0.0, 60.0, 4001))
        x, v = result.position("block"), result.velocity("block")
        left.plot(x, v, style, color=colour, linewidth=1.3, label=name)
        left.plot(x[0], v[0], "o", color=colour, markerfacecolor="white")
        stuck = [event.t for event in result.events if event.after.name == "STUCK"]
        print(f"{name}: {len(result.events)} events, period {stuck[-1] - stuck[-2]:.9f} s")
    left.axhline(BELT, color="0.7", linewidth=0.8, zorder=0, label="belt velocity")
    left.set(xlabel="position of the block [m]", ylabel="velocity of the block [m/s]", title="phase plane")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, fontsize="small", frameon=False)
    plots.characteristic(result, "surface", ax=right)
    right.set(xlabel="relative velocity [m/s]", ylabel="friction force [N]", title="last run: friction force")
    right.legend(loc="upper left", fontsize="small")
    drawing.savefig(figure, dpi=300)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
