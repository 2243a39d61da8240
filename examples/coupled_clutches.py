"""Four inertias joined by three clutches that close one after another: the Modelica example CoupledClutches.

The first inertia turns at 10 rad/s and is driven by an oscillating torque of 5 Hz. Clutch 1 follows a slow cosine,
clutches 2 and 3 are pressed together at 0.4 s and 0.9 s. Clutch 1 locks twice and slips again each time, because the
torque exceeds what it can hold; from 1.25 s on its normal force is negative, so it is open.
"""

import math
import sys
from pathlib import Path

from stickslip import Body, Contact, DryFriction, Force, Scene, simulate, sine, step

FIGURE = Path(__file__).parent / "figures" / "coupled_clutches.png"


def main(figure: Path) -> None:
    """Simulate the four inertias to 1.5 s, print the events and draw them."""
    lining = DryFriction(mu_static=0.55, mu_coulomb=0.5)
    pressure = 20.0
    scene = Scene(
        Body("J1", inertia=1.0, velocity=10.0),
        *(Body(name, inertia=1.0) for name in ("J2", "J3", "J4")),
        Force("J1", sine(10.0, frequency=5.0)),
        Contact("clutch1", "J1", "J2", lining, normal=sine(pressure, frequency=0.2, phase=math.pi / 2)),
        Contact("clutch2", "J2", "J3", lining, normal=step(0.4, 0.0, pressure)),
        Contact("clutch3", "J3", "J4", lining, normal=step(0.9, 0.0, pressure)),
        motion="rotation",
    )
    result = simulate(scene, (0.0, 1.5))
    for event in result.events:
        print(event)
    print("velocities at the end:", *(f"{result.velocity(b.name)[-1]:.9f}" for b in scene.bodies), "rad/s")
    result.plot().savefig(figure, dpi=300)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
