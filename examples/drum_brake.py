"""Leading and trailing shoe of a drum brake: friction presses one on and pushes the other off.

With a lever of lengths a, b and c the normal force is N = F a / (b - mu c) on a leading shoe and F a / (b + mu c) on
a trailing one: coefficients that differ forward and backward. Stopping times are printed beside their closed forms.
The last panel shows both shoes over the coefficient: at mu = b / c the leading shoe locks, and is refused.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from stickslip import GROUND, Body, Contact, DryFriction, Scene, simulate

FIGURE = Path(__file__).parent / "figures" / "drum_brake.png"
FORCE, A, B, C, RADIUS, INERTIA, SPEED, MU = 100.0, 0.3, 0.15, 0.1, 0.2, 2.0, 50.0, 0.4
BRAKES = {"leading": (1,), "trailing": (-1,), "one of each": (1, -1), "two leading": (1, 1)}


def brake(shoes: tuple[int, ...]) -> Scene:
    """Return a drum with shoes: +1 for a leading, -1 for a trailing one."""
    laws = [DryFriction(MU, MU).self_energised(side * C / B) for side in shoes]
    press = FORCE * A / B
    contacts = [Contact(f"shoe{k}", "drum", GROUND, law, normal=press, radius_a=RADIUS) for k, law in enumerate(laws)]
    return Scene(Body("drum", inertia=INERTIA, velocity=SPEED), *contacts, motion="rotation")


def main(figure: Path) -> None:
    """Stop the drum with each brake; print the times; draw the speeds, and the torques over the coefficient."""
    drawing = Figure(figsize=(9.0, 4.2), layout="constrained")
    left, right = drawing.subplots(1, 2)
    lines = ("-", "--", "-.", ":")
    for line, (name, shoes) in zip(lines, BRAKES.items(), strict=True):
        result = simulate(brake(shoes), (0.0, 9.0))
        torque = sum(MU * RADIUS * FORCE * A / (B - side * MU * C) for side in shoes)
        print(f"{name}: stops at {result.events[0].t:.12f} s, exact {INERTIA * SPEED / torque:.12f} s")
        left.plot(result.t, result.velocity("drum"), line, label=name)
    left.set(xlabel="time [s]", ylabel="speed of the drum [rad/s]")
    left.legend()
    try:
        DryFriction(B / C, B / C).self_energised(C / B)
    except ValueError as refusal:
        print(f"refused: {refusal}")
    mu = np.linspace(0.0, 0.99 * B / C, 200)
    for line, side, name in (("-", 1, "leading"), ("--", -1, "trailing")):
        right.plot(mu, mu * RADIUS * FORCE * A / (B - side * mu * C), line, label=name)
    right.axvline(B / C, color="k", linestyle=":", label="locks")
    right.set(xlabel="coefficient of friction", ylabel="torque [N m]", ylim=(0, 150))
    right.legend()
    drawing.savefig(figure, dpi=200)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
