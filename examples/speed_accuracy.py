"""What does accuracy cost? Every way to simulate four flywheels with viscous friction, error against wall time.

`tradeoff` runs the formulations, methods, tolerances, fixed steps and pre-slip velocities that apply to the scene, and
measures each against an event-exact reference so tight that a second one agrees with it. Regularised laws and fixed
steps lose their accuracy at the events; the event-exact calls do not. `recommend` then names the call to paste. In the
figure every call is a marker, and a line joins the best of its family: times on a busy machine scatter. It takes a
minute, with --quick a few seconds.
"""

import argparse
from pathlib import Path

from matplotlib.figure import Figure

from stickslip.benchmark import four_flywheels
from stickslip.studies.tradeoff import tradeoff

FIGURE = Path(__file__).parent / "figures" / "speed_accuracy.png"


def main(figure: Path, budget: float) -> None:
    """Measure within a budget in s, print what is recommended, and draw error against time."""
    study = tradeoff(four_flywheels(viscous=5.0), (0.0, 4.0), budget=budget)
    print("calls that no other call beats in both:")
    for row in study.work.pareto():
        print(f"  {1e3 * row.median:8.2f} ms  error {row.error:.1e}  {row.call}")
    print(f"the reference can tell errors down to {study.limit:.1e} rad/s")
    for error in (1e-3, 1e-6):
        try:
            print(f"for an error of {error:g} rad/s: {study.recommend(error=error)}")
        except ValueError as none:
            print(none)
    drawing = Figure(figsize=(10.0, 6.0), layout="constrained")
    ax = study.plot(drawing.subplots())
    ax.set(title="four flywheels with viscous friction", ylabel="largest velocity error [rad/s]")
    ax.set_xlabel("median wall time [s]")
    drawing.savefig(figure, dpi=150)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("figure", nargs="?", type=Path, default=FIGURE)
    parser.add_argument("--quick", action="store_true", help="a budget of 2 s instead of 60 s")
    chosen = parser.parse_args()
    main(chosen.figure, 2.0 if chosen.quick else 60.0)
