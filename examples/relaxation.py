"""A block that viscous friction brings to rest: its velocity approaches zero without ever crossing it.

The contact has no Coulomb friction while it slides, but it can hold up to a static level. No zero crossing comes, so
none can be found: the contact counts as stuck where the velocity has become constant and lies within the velocity
margin, which here the tolerances set. Then it holds against a growing pull, exactly, and lets go at its static level.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    DryFriction,
    Force,
    Scene,
    piecewise_linear,
    plots,
    simulate,
)

FIGURE = Path(__file__).parent / "figures" / "relaxation.png"


def main(figure: Path) -> None:
    """Let a block relax to rest, pull it loose, and draw both on a linear and a logarithmic axis."""
    pull = piecewise_linear([15.0, 19.0, 21.0, 21.0], [0.0, 4.0, 4.0, 0.0])
    scene = Scene(
        Body("block", inertia=1.0, velocity=1.0),
        Damper("block", GROUND, damping=2.0),
        Contact("floor", "block", GROUND, DryFriction(0.3, 0.0), normal=10.0),
        Force("block", pull),
    )
    result = simulate(scene, (0.0, 36.0))
    for event in result.events:
        print(event)
    print("the pull reaches the static level of 3 N at 18 s")

    drawing = Figure(figsize=(9.0, 7.0), layout="constrained")
    axes = drawing.subplots(3, 1, sharex=True)
    plots.velocities(result, ax=axes[0]).set(xlabel="", ylabel="velocity [m/s]")
    times = np.linspace(0.0, 36.0, 3601)
    speed = np.abs(result(times)[0])
    axes[1].semilogy(times, np.where(speed > 0, speed, np.nan), "k", label="magnitude;\nblank: exactly 0")
    axes[1].set(ylabel="velocity [m/s]")
    axes[1].legend(loc="lower left", fontsize="small", frameon=False, bbox_to_anchor=(1.0, 0.8))
    plots.contact_forces(result, "floor", ax=axes[2]).set_ylabel("friction force [N]")
    for event in result.events:
        axes[1].axvline(event.t, color="0.7", linewidth=0.6)
    drawing.savefig(figure, dpi=300)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
