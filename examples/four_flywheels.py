"""Four flywheels in a row, braked once, without and with viscous friction between them (Breedveld 2000, figs. 11, 12).

The contacts get weaker with the distance from the brake, so the first wheel is torn off the others and stands still
for a while. Viscous friction in parallel drags the first wheel along with the others: the same brake no longer brings
it to a stop. The figure shows both runs, one above the other.
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

from stickslip import plots, simulate
from stickslip.benchmark import four_flywheels

FIGURE = Path(__file__).parent / "figures" / "four_flywheels.png"


def main(figure: Path) -> None:
    """Simulate the chain twice and draw velocities and modes of both runs."""
    drawing = Figure(figsize=(9.0, 8.5), layout="constrained")
    axes = drawing.subplots(4, 1, sharex=True, height_ratios=(2.4, 1.4, 2.4, 1.4))
    cases = {"dry friction only": 0.0, "with viscous friction, 5 N m s/rad": 5.0}
    for (title, viscous), (top, bottom) in zip(cases.items(), (axes[:2], axes[2:]), strict=True):
        result = simulate(four_flywheels(viscous=viscous), (0.0, 1.5))
        print(f"{title}: {len(result.events)} events")
        for event in result.events:
            print(f"  {event}")
        final = ", ".join(f"{result.velocity(body.name)[-1]:.6f}" for body in result.scene.bodies)
        print(f"  velocities at the end: {final} rad/s")
        plots.velocities(result, ax=top).set(title=title, xlabel="", ylabel="velocity [rad/s]")
        plots.modes(result, ax=bottom).set_xlabel("")
    axes[-1].set_xlabel("time [s]")
    drawing.savefig(figure, dpi=300)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
