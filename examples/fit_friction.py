"""Friction from a noisy record of stick-slip: static and kinetic coefficients, dwell time, Stribeck velocity.

A block is pulled by a spring whose end moves slowly, then faster: it sticks for longer and for shorter times. Its
velocity is "measured" with noise. The fit finds four numbers of the law, and how well each is determined.
"""

import sys
from dataclasses import dataclass
from math import exp
from pathlib import Path

import numpy as np

from stickslip import GROUND, Body, Contact, Drive, DryFriction, Scene, Spring, fit, simulate, step

FIGURE = Path(__file__).parent / "figures" / "fit_friction.png"
STOP, NOISE, REST = 9.0, 0.01, 0.45


@dataclass(frozen=True)
class Stribeck:
    """Falls from a value at rest, below the static coefficient, to the Coulomb coefficient."""

    coulomb: float
    velocity: float

    def __call__(self, speed: float) -> float:
        """Return the kinetic coefficient."""
        return self.coulomb + (REST - self.coulomb) * exp(-speed / self.velocity)


def scene(static: float, coulomb: float, dwell: float, velocity: float) -> Scene:
    """Return the block, the hand and the floor."""
    law = DryFriction(static, REST, dwell=dwell, kinetic=Stribeck(coulomb, velocity))
    return Scene(
        Body("block", inertia=1.0),
        Drive("hand", velocity=step(6.5, 0.3, 0.6)),
        Spring("block", "hand", stiffness=10.0, damping=0.1),
        Contact("floor", "block", GROUND, law, normal=10.0),
        motion="translation",
    )


def main(figure: Path) -> None:
    """Make the record, fit it, and draw data, fit and residuals."""
    true, t = (0.6, 0.3, 1.0, 0.2), np.linspace(0.05, STOP, 350)
    clean = simulate(scene(*true), (0.0, STOP), t_eval=t).velocity("block")
    noisy = clean + NOISE * np.random.default_rng(0).normal(size=t.size)
    names = [f"floor.law.{one}" for one in ("mu_static", "kinetic.coulomb", "dwell", "kinetic.velocity")]
    data = {"block.velocity": (t, noisy, NOISE)}
    found = fit(scene(0.57, 0.28, 1.3, 0.25), names, data, rtol=1e-7, atol=1e-9)
    print(found)
    off = np.abs(found.values - true) / found.standard_errors
    print(f"off by {off.max():.1f} standard errors at most")
    found.plot().savefig(figure, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
