"""The benchmark of Breedveld (2000): two flywheels with dry friction between them, and a brake on the first.

The brake acts twice. The interface holds the first, weaker time. The second time it breaks loose, wheel 1 comes to
a standstill, and the interface drags it off the dying brake before both wheels lock again. The script prints the
time of each event beside the exact one, and draws what happened.
"""

import sys
from pathlib import Path

from stickslip import GROUND, Body, Contact, DryFriction, Scene, simulate, triangle
from stickslip.benchmark import EXACT_EVENTS

FIGURE = Path(__file__).parent / "figures" / "flywheel_brake.png"


def main(figure: Path) -> None:
    """Simulate the benchmark, compare its events with the exact ones, and draw it."""
    dry = DryFriction(mu_static=0.2, mu_coulomb=0.1, dwell=0.1)
    pulses = triangle(0.05, 0.10, 0.15, slope=3000) + triangle(0.4, 0.5, 0.6, slope=3000)
    scene = Scene(
        Body("wheel1", inertia=1.0, velocity=1.0),
        Body("wheel2", inertia=10.0, velocity=1.01),
        Contact("interface", "wheel1", "wheel2", dry, normal=100.0),
        Contact("brake", "wheel1", GROUND, dry, normal=pulses),
        motion="rotation",
    )
    result = simulate(scene, (0.0, 4.0))
    for event, exact in zip(result.events, EXACT_EVENTS, strict=True):
        change = f"{event.contact}: {event.before.name} -> {event.after.name}"
        print(f"{event.t:.12f} s  {change:32} off by {event.t - exact.t:8.1e} s")
    print(f"both wheels turn on with {result.velocity('wheel1')[-1]:.12f} rad/s")
    print(f"energy balance error {result.energy().relative_error:.1e} of the largest energy")
    # nothing changes after 0.65 s
    result.plot(t_span=(0.0, 0.8)).savefig(figure, dpi=300)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
