"""A PID controller hunts for ever against stiction (Armstrong and Amin 1996).

The integral winds up while the slide sticks; when it lets go, Coulomb friction is less than what held it, and it goes
too far. The limit cycle has an exact solution: amplitude, slip phase and stick phase are printed beside it. The
controller is linear between the events, so the series engine is right to roundoff.
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

import stickslip as st

FIGURE = Path(__file__).parent / "figures" / "pid_hunting.png"
EXACT = {"amplitude": 0.067240146920867, "slip phase": 2.56843892210513, "stick phase": 9.11619722443900}


def main(figure: Path) -> None:
    """Let the slide hunt; print the limit cycle beside the exact one; draw position, forces and phases."""
    controller = st.pid("pid", 1 - st.position("slide"), kp=3.0, ki=4.0, kd=6.0, rate=-1 * st.velocity("slide"))
    guide = st.Contact("guide", "slide", st.GROUND, st.DryFriction(1.5, 1.0), normal=1.0)
    scene = st.Scene(st.Body("slide", inertia=1.0), guide, controller, st.Force("slide", st.output("pid")))
    result = st.simulate(scene, (0.0, 200.0))
    last = max(k for k, event in enumerate(result.events) if event.after == st.Mode.STUCK)
    stop, go, halt = (event.t for event in result.events[last - 2 : last + 1])
    amplitude = abs(1 - result.sample([stop]).position("slide")[0])
    found = {"amplitude": amplitude, "slip phase": halt - go, "stick phase": go - stop}
    for name, value in found.items():
        print(f"{name} {value:.12f}, exact {EXACT[name]:.12f}")

    late = result.sample(4001)
    drawing = Figure(figsize=(9.0, 6.0), layout="constrained")
    axes = drawing.subplot_mosaic("WWP;FFP")
    axes["W"].plot(late.t, late.position("slide"))
    axes["W"].set(ylabel="position [m]", xlabel="time [s]")
    axes["F"].plot(late.t, late.output("pid"), label="controller")
    axes["F"].plot(late.t, late.force("guide"), label="friction", linestyle="--")
    axes["F"].set(ylabel="force [N]", xlabel="time [s]", xlim=(100, 160), ylim=(-1.8, 2.4))
    axes["F"].legend(loc="upper right", ncols=2)
    axes["P"].plot(late.position("slide"), late.velocity("slide"), linewidth=0.9)
    axes["P"].set(xlabel="position [m]", ylabel="velocity [m/s]", xlim=(0.9, 1.1), ylim=(-0.12, 0.12))
    drawing.savefig(figure, dpi=200)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
