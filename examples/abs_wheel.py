"""Emergency braking with a wheel that locks, and with a sampled controller that lets it go in time (ABS).

The tyre holds more while it rolls than while it slides. The controller reads the slip every 5 ms: where the tyre slides
it lets go, and asks for less from then on. The stopping distance with a locked wheel has a closed form, and none is
shorter than that at the full static level. All is linear between events: the series engine takes both.
"""

import sys
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

import stickslip as st

FIGURE = Path(__file__).parent / "figures" / "abs_wheel.png"
SPEED, MASS, RADIUS, WEIGHT, TORQUE, STATIC, SLIDING = 30.0, 400.0, 0.3, 3924.0, 1500.0, 1.0, 0.7


def car(controlled: bool) -> st.Scene:
    """Return wheel and car; the brake is closed by the controller, behind a lag, or at once and for good."""
    slides: Any = lambda u: u[1] - RADIUS * u[0] > 0.01 * u[1]  # noqa: E731
    # the state is the part of the torque that it asks for while the tyre rolls
    does: dict[str, Any] = {"update": lambda t, x, u: x * (0.98 if slides(u) else 1.001)}
    does |= {"output": lambda t, x, u: 0.3 if slides(u) else x}
    speeds = [st.velocity("wheel"), st.velocity("car")]
    control = st.Sampled("abs", period=0.005, inputs=speeds, states=[0.9], **does)
    lag = st.StateSpace("valve", [[-100.0]], [[100.0]], [[TORQUE]], inputs=[st.output("abs")])
    pressed, lining = st.output("valve") if controlled else TORQUE, st.DryFriction(1.0, 1.0)
    return st.Scene(
        st.Body("car", inertia=MASS, velocity=SPEED),
        st.Body("wheel", inertia=1.0, velocity=SPEED / RADIUS),
        st.Contact("tyre", "wheel", "car", st.DryFriction(STATIC, SLIDING), normal=WEIGHT, radius_a=RADIUS),
        st.Contact("brake", "wheel", "ground", lining, normal=pressed),
        *((control, lag) if controlled else ()),
    )


def main(figure: Path) -> None:
    """Brake with both; print the ways beside their bounds; draw speeds and brake torques."""
    axes = Figure(figsize=(9, 6), layout="constrained").subplots(2, 2, sharex=True, sharey="row")
    halt = st.When("halt", st.velocity("car") - 1e-6, direction=-1, stop=True)
    longest, shortest = (SPEED**2 / (2 * mu * WEIGHT / MASS) for mu in (SLIDING, STATIC))
    for (above, below), name in zip(axes.T, ("locked", "ABS"), strict=True):
        result = st.simulate(car(name == "ABS"), (0.0, 10.0), events=[halt])
        print(f"{name}: {result.position('car')[-1]:.6f} m; {result.stats['samples']} samples")
        above.plot(result.t, result.velocity("car"), label="car")
        above.plot(result.t, RADIUS * result.velocity("wheel"), label="rim", linestyle="--", linewidth=0.9)
        above.legend(title=name)
        below.plot(result.t, result.force("brake"), linewidth=0.9)
        below.set_xlabel("time [s]")
    print(f"exact: locked {longest:.6f} m; no less than {shortest:.6f} m")
    axes[0, 0].set_ylabel("speed [m/s]")
    axes[1, 0].set_ylabel("torque of the brake [N m]")
    axes[0, 0].figure.savefig(figure, dpi=200)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
