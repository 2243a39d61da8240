"""Squeal by mode coupling: from which friction coefficient on a brake pad begins to swing by itself, and how fast.

A pad moves along and across a disc, on springs at 30 and 150 degrees; a third presses it on. Friction couples both
motions: their frequencies meet where the coefficient is sqrt(3) / 6, and from there on one motion grows.
"""

import math
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import bisect

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, Spring, linearize, position, simulate

FIGURE = Path(__file__).parent / "figures" / "brake_squeal.png"
PRESS, LOAD, SPRINGS = 1.5, 10.0, ((2.0, math.sqrt(0.75), 0.5), (1.0, -math.sqrt(0.75), 0.5))


def pad(mu: float, off: float = 0.0) -> Scene:
    """Return a pad of 1 kg on a disc that runs on, at rest where friction and springs balance, or a little off."""
    press = PRESS * np.array([[0.0, -mu], [0.0, 1.0]])
    stiffness = press + sum(k * np.outer((c, s), (c, s)) for k, c, s in SPRINGS)
    along, across = np.linalg.solve(stiffness, [mu * LOAD, 0.0])
    return Scene(
        Body("along", inertia=1.0, position=along + off),
        Body("across", inertia=1.0, position=across),
        Drive("disc", velocity=10.0),
        *(Spring("along", "across", stiffness=k, radius_a=c, radius_b=-s) for k, c, s in SPRINGS),
        Spring("across", GROUND, stiffness=PRESS),
        Contact("rub", "along", "disc", DryFriction(mu, mu), normal=LOAD + PRESS * position("across")),
        motion="translation",
    )


def main(figure: Path) -> None:
    """Print onset and growth, and draw frequencies and growth rates over the coefficient."""
    onset = bisect(lambda mu: linearize(pad(mu)).eigenvalues[0].real - 1e-9, 0.1, 0.5, xtol=1e-15)
    print(f"squeal from mu = {onset:.9f}, exact {math.sqrt(3) / 6:.9f}")
    model = linearize(pad(0.32))
    turn = 2 * math.pi / float(model.frequencies[0])
    run = simulate(pad(0.32, off=1e-3), (0.0, 42 * turn)).sample(turn * np.linspace(0.0, 42.0, 16801))
    early, late = (np.ptp(run.velocity("along")[400 * k : 400 * k + 400]) for k in (20, 40))
    rate, swung = model.eigenvalues[0].real, np.log(late / early) / (20 * turn)
    print(f"at mu = 0.32 it grows by {rate:.5f} 1/s, simulated {swung:.5f} 1/s")
    mu = np.linspace(0.0, 0.6, 241)
    found = [linearize(pad(one)).eigenvalues for one in mu]
    fig, (top, bottom) = plt.subplots(2, sharex=True, figsize=(6.4, 5.2), layout="constrained")
    top.plot(mu, [np.sort(one.imag[one.imag > 0]) for one in found], color="C0")
    bottom.plot(mu, [one.real.max() for one in found], color="C3")
    bottom.axvline(onset, color="0.35", linestyle="--", linewidth=1.0)
    top.set_ylabel("frequencies [rad/s]")
    bottom.set(xlabel="friction coefficient (dashed: onset)", ylabel="growth rate [1/s]")
    fig.savefig(figure, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
