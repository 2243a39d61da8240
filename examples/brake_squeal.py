"""Squeal by mode coupling: from which friction coefficient on a brake pad begins to swing by itself, and how fast.

A pad moves along and across a disc, on springs at 30 and 150 degrees, and is pressed on by a third. Friction couples
both motions: their frequencies meet where the coefficient is sqrt(3) / 6, and from there on one motion grows.
"""

import math
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, Spring, linearize, position, simulate

FIGURE = Path(__file__).parent / "figures" / "brake_squeal.png"
EXACT = math.sqrt(3) / 6


SPRINGS = (2.0, math.pi / 6), (1.0, 5 * math.pi / 6)


def pad(mu: float, off: float = 0.0) -> Scene:
    """Return a pad of 1 kg on a disc that runs on, at rest where friction and springs balance, or a little off."""
    press, load = 1.5, 10.0
    stiffness = np.diag([0.0, press])
    for k, angle in SPRINGS:
        direction = np.array([math.cos(angle), math.sin(angle)])
        stiffness += k * np.outer(direction, direction)
    stiffness[0, 1] -= mu * press
    along, across = np.linalg.solve(stiffness, [mu * load, 0.0])
    springs = [
        Spring("along", "across", stiffness=k, radius_a=math.cos(angle), radius_b=-math.sin(angle))
        for k, angle in SPRINGS
    ]
    return Scene(
        Body("along", inertia=1.0, position=along + off),
        Body("across", inertia=1.0, position=across),
        Drive("disc", velocity=10.0),
        *springs,
        Spring("across", GROUND, stiffness=press),
        Contact("rub", "along", "disc", DryFriction(mu, mu), normal=load + press * position("across")),
        motion="translation",
    )


def onset() -> float:
    """Return by bisection the coefficient from which on the linear model is not stable."""
    low, high = 0.1, 0.5
    while (middle := 0.5 * (low + high)) not in (low, high):
        low, high = (middle, high) if linearize(pad(middle)).eigenvalues[0].real < 1e-9 else (low, middle)
    return high


def growth(mu: float) -> tuple[float, float]:
    """Return the growth rate of the swinging pad in 1/s, by the linear model and by simulation."""
    model = linearize(pad(mu))
    turn = 2 * math.pi / float(model.frequencies[0])
    result = simulate(pad(mu, off=1e-3), (0.0, 42 * turn))
    one = turn * np.linspace(0.0, 1.0, 400)
    early, late = (np.ptp(result.sample(k * turn + one).velocity("along")) for k in (20, 40))
    return float(model.eigenvalues[0].real), float(np.log(late / early) / (20 * turn))


def main(figure: Path) -> None:
    """Tell onset and growth, and draw frequencies and growth rates over the coefficient."""
    print(f"squeal from mu = {onset():.9f}, exact {EXACT:.9f}")
    rate, measured = growth(0.32)
    print(f"at mu = 0.32 it grows by {rate:.5f} 1/s, simulated {measured:.5f} 1/s")
    mu = np.linspace(0.0, 0.6, 241)
    found = [np.sort_complex(linearize(pad(one)).eigenvalues) for one in mu]
    fig, (top, bottom) = plt.subplots(2, 1, sharex=True, figsize=(6.4, 5.2), layout="constrained")
    for values in np.array([np.sort(one.imag[one.imag > 0]) for one in found]).T:
        top.plot(mu, values, color="C0")
    bottom.plot(mu, [one.real.max() for one in found], color="C3")
    for ax in (top, bottom):
        ax.axvline(EXACT, color="0.35", linestyle="--", linewidth=1.0)
    top.set(ylabel="frequencies [rad/s]", title="a brake pad: two motions meet, and one grows")
    bottom.set(xlabel="friction coefficient", ylabel="growth rate [1/s]")
    fig.savefig(figure, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
