"""A clutch that grows hot and slippery: its heat is the state of a block, and weakens the clutch.

The power of the contact is the input of a block that adds it up. Its output lowers the normal force. The heat does
not depend on how the clutch fades: it is the kinetic energy that vanishes. With it the lock-up time has a closed form,
an arctangent; where the clutch fades more, it never locks. Both are printed beside what is simulated.
"""

import sys
from math import atan, atanh, sqrt, tanh
from pathlib import Path

from matplotlib.figure import Figure

from stickslip import Block, Body, Contact, DryFriction, Scene, output, power, simulate

FIGURE = Path(__file__).parent / "figures" / "thermal_clutch.png"
ENGINE, LOAD, SPEED, TORQUE = 0.2, 1.0, 150.0, 120.0
JOINED, HEAT = ENGINE * LOAD / (ENGINE + LOAD), 0.5 * ENGINE * LOAD / (ENGINE + LOAD) * SPEED**2


def clutch(fade: float) -> Scene:
    """Return a motor and a load; the clutch loses the part `fade` of its torque per joule of heat."""
    heat = Block("heat", inputs=[power("clutch")], states=[0.0], derivative=lambda t, x, u: u)
    normal = TORQUE - TORQUE * fade * output("heat")
    lining = Contact("clutch", "motor", "load", DryFriction(1.0, 1.0), normal=normal)
    bodies = Body("motor", inertia=ENGINE, velocity=SPEED), Body("load", inertia=LOAD)
    return Scene(*bodies, heat, lining)


def main(figure: Path) -> None:
    """Engage the clutch with more and more fade; print times and heat; draw speeds, heat and torque."""
    speeds, heats, torques = Figure(figsize=(9.0, 7.0), layout="constrained").subplots(3, 1, sharex=True)
    for number, part in enumerate((0.0, 0.4, 0.7, 1.2)):
        result = simulate(clutch(part / HEAT), (0.0, 1.0), rtol=1e-9)
        # with Q = J (w0^2 - w^2) / 2 the clutch slows down as w' = -(a + b w^2)
        a, b = TORQUE / JOINED * (1 - part), 0.5 * TORQUE * part / HEAT
        if a < 0:
            exact = sqrt(-a / b) / tanh(sqrt(-a * b) + atanh(sqrt(-a / b) / SPEED))
            left = result.velocity("motor")[-1] - result.velocity("load")[-1]
            print(f"fade {part:.0%}: slips at {left:.6f} rad/s after 1 s, exact {exact:.6f} rad/s")
        else:
            exact = atan(SPEED * sqrt(b / a)) / sqrt(a * b) if b else SPEED / a
            made = f"heat {result.state('heat')[-1]:.5f} J, exact {HEAT:.5f} J"
            print(f"fade {part:.0%}: locks at {result.events[0].t:.8f} s, exact {exact:.8f} s; {made}")
        look = {"color": f"C{number}", "linestyle": ("-", "--", "-.", ":")[number]}
        speeds.plot(result.t, result.velocity("motor"), **look)
        speeds.plot(result.t, result.velocity("load"), linewidth=0.8, **look)
        heats.plot(result.t, result.state("heat"), label=f"fades by {part:.0%}", **look)
        torques.plot(result.t, result.force("clutch"), **look)
    speeds.set(ylabel="speed [rad/s]\n(thin: load)", xlim=(0.0, 0.6))
    heats.set(ylabel="heat [J]")
    heats.legend()
    torques.set(ylabel="torque of the clutch [N m]", xlabel="time [s]")
    speeds.figure.savefig(figure, dpi=200)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
