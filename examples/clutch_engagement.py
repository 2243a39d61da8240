"""A motor is coupled to a load at rest by a friction clutch whose normal force rises along a ramp.

The clutch slips until both sides turn alike, then it locks at an exact time and carries less than it could. The
energy ledger tells how much heat the slip has made; it must balance. The last panel shows the ledger over time.
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from stickslip import Body, Contact, Damper, DryFriction, Force, Scene, piecewise_linear, plots, simulate

FIGURE = Path(__file__).parent / "figures" / "clutch_engagement.png"


def main(figure: Path) -> None:
    """Engage the clutch; print lock-up time and heat; draw the motion and the energy."""
    # the coefficients hold the mean radius of 0.1 m, so that friction is a torque
    lining = DryFriction(mu_static=0.045, mu_coulomb=0.035)
    scene = Scene(
        Body("motor", inertia=0.2, velocity=150.0),
        Body("load", inertia=1.0),
        Damper("load", "ground", damping=0.15),
        Force("motor", 40.0),
        Contact("clutch", "motor", "load", lining, normal=piecewise_linear([0.2, 0.8], [0.0, 3000.0])),
        motion="rotation",
    )
    result = simulate(scene, (0.0, 2.5))
    ledger = result.energy()
    lock = next(event for event in result.events if event.after.name == "STUCK")
    print(f"locked at {lock.t:.9f} s with {result(lock.t)[0]:.6f} rad/s")
    print(f"torque through the locked clutch at the end {result.force('clutch')[-1]:.4f} N m")
    print(f"heat in the clutch {ledger.contacts['clutch'][-1]:.3f} J")
    print(f"energy balance error {ledger.relative_error:.1e} of the largest energy")

    drawing = Figure(figsize=(9.0, 9.0), layout="constrained")
    axes = drawing.subplots(5, 1, sharex=True, height_ratios=(2.2, 1.1, 1.8, 1.4, 2.0))
    plots.overview(result, axes=axes[:4])
    axes[0].set_ylabel("velocity [rad/s]")
    axes[2].set_ylabel("torque [N m]")
    axes[3].set_xlabel("")
    plots.energy(result, ax=axes[4])
    drawing.align_ylabels(axes)
    drawing.savefig(figure, dpi=300)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
