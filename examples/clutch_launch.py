"""A car is launched: an engine with a torque map, a clutch whose friction falls with the slip, an elastic driveline.

The map is a table over the engine's speed; its corners are located like events. Friction that falls with the slip feeds
the swing of the driveline: judder. How fast it swings and grows is an eigenvalue of a matrix written by hand.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import stickslip as st

FIGURE = Path(__file__).parent / "figures" / "clutch_launch.png"
INERTIAS = {"engine": 0.2, "hub": 0.05, "car": 3.0}
K, C, LEVEL, FALL, PRESS = 600.0, 0.3, 1.6, 0.006, 100.0
SPEEDS, TORQUES = [0.0, 80.0, 200.0, 400.0, 500.0], [20.0, 50.0, 80.0, 80.0, 0.0]


def launch() -> st.Scene:
    """Return engine, hub and car; all inertias at the clutch, whose radius is in the coefficients."""
    lining = st.DryFriction(LEVEL, LEVEL, kinetic=lambda slip: LEVEL - FALL * slip)
    return st.Scene(
        *(st.Body(name, inertia=J, velocity=130.0 * (name == "engine")) for name, J in INERTIAS.items()),
        st.Spring("hub", "car", stiffness=K, damping=C),
        st.Contact("clutch", "engine", "hub", lining, normal=st.piecewise_linear([0.0, 0.1], [0.0, PRESS])),
        st.Force("engine", st.table(st.velocity("engine"), SPEEDS, TORQUES)),
    )


def main(figure: Path) -> None:
    """Launch; print lock-up, heat and judder beside the matrix; draw speeds, torque and swing."""
    result = st.simulate(launch(), (0.0, 2.0), rtol=1e-8)
    print(f"locked at {result.events[0].t:.6f} s, heat {result.energy().contacts['clutch'][-1]:.1f} J")
    f, rise = PRESS * FALL, 0.25  # slopes of the clutch's torque over the slip, and of the map over the speed
    matrix = np.array([[rise + f, -f, 0, 0], [-f, f - C, C, -K], [0, C, -C, K], [0, 1, -1, 0]])
    exact = max(np.linalg.eigvals(matrix / [[0.2], [0.05], [3.0], [1.0]]), key=lambda value: value.imag)
    fine = result.sample(np.linspace(0.15, 0.6, 20001))
    swing, late = fine.velocity("hub") - fine.velocity("car"), result.sample(4001)
    turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(swing))))
    spans, t = np.abs(np.diff(swing[turns])), fine.t[turns]
    print(f"judder at {np.pi * spans.size / (t[-1] - t[0]):.2f} rad/s, by hand {exact.imag:.2f} rad/s")
    print(f"grows by {np.log(spans[-1] / spans[0]) / (t[-2] - t[0]):.2f} /s, by hand {exact.real:.2f} /s")
    axes = Figure(figsize=(9, 7), layout="constrained").subplots(3, sharex=True)
    for name, line in zip(INERTIAS, ("-", "--", "-."), strict=True):
        axes[0].plot(late.t, late.velocity(name), line, label=name)
    axes[0].set_ylabel("speed [rad/s]")
    axes[1].plot(late.t, late.force("clutch"))
    axes[1].set_ylabel("torque [N m]")
    axes[2].plot(late.t, late.velocity("hub") - late.velocity("car"), linewidth=1.0)
    axes[2].plot(fine.t, 0.5 * spans[0] * np.exp(exact.real * (fine.t - t[0])), "k--")
    axes[2].set(ylabel="hub less car [rad/s]\n(dashed: growth by hand)", xlabel="time [s]", xlim=(0.0, 2.0))
    axes[0].legend()
    axes[0].figure.savefig(figure, dpi=200)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
