"""A drill string as a torsional chain of twenty discs: the top turns steadily, the bit sticks and slips.

The rotary table turns the top disc, springs with damping turn the others, and dry friction at the bit falls with speed
(Stribeck). The bit stands still while the string winds up, breaks away, spins at twice the speed of the table and more,
and is caught again. The heat map shows the torsional waves that run up and down the string.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip import GROUND, Body, Contact, Damper, Drive, DryFriction, Scene, Spring, plots, simulate

FIGURE = Path(__file__).parent / "figures" / "drill_string.png"
DISCS, TABLE = 20, 5.0


def main(figure: Path) -> None:
    """Simulate 30 s of drilling and draw the bit, its friction and the whole string."""
    names = [f"disc{i}" for i in range(1, DISCS)] + ["bit"]
    # the friction torque per unit of weight on the bit has the unit m
    rock = DryFriction(mu_static=0.09, mu_coulomb=0.05, stribeck_velocity=1.5, stribeck_exponent=1.0)
    scene = Scene(
        Drive("table", velocity=TABLE),
        *(Body(name, inertia=20.0, velocity=TABLE) for name in names),
        *(
            Spring(above, below, stiffness=1e4, damping=8.0)
            for above, below in zip(["table", *names], names, strict=False)
        ),
        *(Damper(name, GROUND, damping=2.0) for name in names),
        Contact("rock", "bit", GROUND, rock, normal=80e3),
        motion="rotation",
    )
    result = simulate(scene, (0.0, 30.0), rtol=1e-6, atol=1e-8)
    stuck = [event.t for event in result.events if event.after.name == "STUCK"]
    print(f"the bit sticks {len(stuck)} times, at last every {np.diff(stuck)[-1]:.6f} s")
    print(f"fastest {result.velocity('bit').max():.3f} rad/s, table {TABLE:g} rad/s")
    print(f"energy balance error {result.energy().relative_error:.1e} of the largest energy")

    drawing = Figure(figsize=(9.0, 8.0), layout="constrained")
    axes = drawing.subplots(3, 1, sharex=True, height_ratios=(2.6, 1.8, 1.8))
    plots.velocities(result, names, ax=axes[0]).set_xlabel("")
    axes[0].child_axes[0].set_ylabel("velocity [rad/s]")
    plots.velocities(result, ["bit", "table"], ax=axes[1]).set(xlabel="", ylabel="velocity [rad/s]", ylim=(-2.5, 24.0))
    plots.contact_forces(result, "rock", ax=axes[2]).set(ylim=(0.0, 10e3), ylabel="friction torque [N m]")
    for ax in axes[1:]:
        ax.legend(loc="upper right", ncols=4, fontsize="small", frameon=False)
    drawing.savefig(figure, dpi=300)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
