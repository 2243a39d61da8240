"""A pendulum with a dry pivot, let go from nearly upside down.

Its weight is a function of its angle, and friction in the pivot takes the same torque at every angle. Where it turns
follows from the energy alone, whatever happens between: each turning point is printed beside the root of that
equation. It comes to rest not at the lowest point, but where the weight is within the level of the friction.
"""

import sys
from math import cos, sin
from pathlib import Path

from matplotlib.figure import Figure
from scipy.optimize import brentq

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, feedback, position, simulate

FIGURE = Path(__file__).parent / "figures" / "dry_pendulum.png"
WEIGHT, FRICTION, START = 9.81, 0.5, 3.0


def next_turn(angle: float) -> float:
    """Return the next turning angle: on the way there friction takes all the work of the weight."""
    side = 1 if angle > 0 else -1
    left = lambda x: WEIGHT * (cos(x) - cos(angle)) - FRICTION * abs(angle - x)  # noqa: E731
    return float(brentq(left, 0.0, -side * abs(angle), xtol=1e-15))


def main(figure: Path) -> None:
    """Let it swing until it rests; print where it turns; draw the angle, and the phase plane."""
    weight = feedback(lambda x: -WEIGHT * sin(x), position("bob"), derivatives=lambda x: -WEIGHT * cos(x))
    pivot = Contact("pivot", "bob", GROUND, DryFriction(FRICTION, FRICTION), normal=1.0)
    scene = Scene(Body("bob", inertia=1.0, position=START), pivot, Force("bob", weight), motion="rotation")
    result = simulate(scene, (0.0, 30.0), rtol=1e-11)
    turns, angle = result.sample([event.t for event in result.events]), START
    for t, found in zip(turns.t[:5], turns.position("bob"), strict=False):
        angle = next_turn(angle)
        print(f"turns at {t:.6f} s, {found:+.9f} rad; from the energy {angle:+.9f} rad")
    rest = result.position("bob")[-1]
    heat = WEIGHT * (cos(rest) - cos(START))
    print(f"rests at {rest:+.6f} rad; heat {result.energy().contacts['pivot'][-1]:.6f} J, from the way {heat:.6f} J")

    fine = result.sample(3001)
    drawing = Figure(figsize=(9.0, 4.2), layout="constrained")
    left, right = drawing.subplots(1, 2, width_ratios=(3, 2))
    left.plot(fine.t, fine.position("bob"))
    left.plot(turns.t, turns.position("bob"), "k.", label="turns")
    left.set(xlabel="time [s]", ylabel="angle [rad]")
    left.legend()
    right.plot(fine.position("bob"), fine.velocity("bob"), linewidth=0.9)
    right.set(xlabel="angle [rad]", ylabel="velocity [rad/s]")
    drawing.savefig(figure, dpi=200)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
