"""Where does a block on a belt stick and slip, and where does it slide steadily? A map over belt speed and damping.

Every point of the grid is a simulation of its own; its value is the part of the time, after a transient, in which the
block sticks to the belt. `sweep` spreads the points over processes. With --dask they go to a local dask cluster; an
executor of any other cluster would do as well, and the numbers are the same. The 256 points take about 20 s on two
cores that have nothing else to do, the 9 of --quick a few seconds.
"""

import argparse
from pathlib import Path

import numpy as np

from stickslip import Body, Contact, Drive, DryFriction, Scene, Spring, simulate, sweep
from stickslip.studies.sweeps import SweepResult

FIGURE = Path(__file__).parent / "figures" / "stick_slip_map.png"


def stuck_part(speed: float, damping: float) -> float:
    """Return the part of the time from 40 s to 80 s in which the block sticks, at a belt speed in m/s."""
    rough = DryFriction(mu_static=0.5, mu_coulomb=0.3, stribeck_velocity=0.2, stribeck_exponent=1.0)
    scene = Scene(
        Body("block", inertia=1.0),
        Drive("belt", velocity=speed),
        Spring("block", "ground", stiffness=1.0, damping=damping),
        Contact("surface", "block", "belt", rough, normal=1.0),
        motion="translation",
    )
    times = np.linspace(40.0, 80.0, 2001)
    result = simulate(scene, (0.0, 80.0), t_eval=times, rtol=1e-6, atol=1e-8)
    return float(np.mean(result.mode("surface") == 0))


def compute(points: int, dask: bool) -> SweepResult:
    """Return the map on a grid of points by points."""
    grid = {"speed": np.geomspace(0.05, 1.0, points), "damping": np.linspace(0.0, 0.8, points)}
    if not dask:
        return sweep(stuck_part, grid, progress=False)
    from distributed import Client, LocalCluster

    local = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0")
    with local as cluster, Client(cluster) as client:
        return sweep(stuck_part, grid, executor=client.get_executor(pure=False), progress=False)


if __name__ == "__main__":
    from stickslip import plots  # not needed by the processes that simulate

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("figure", nargs="?", type=Path, default=FIGURE)
    parser.add_argument("--dask", action="store_true", help="use a dask LocalCluster")
    parser.add_argument("--quick", action="store_true", help="a coarse map")
    chosen = parser.parse_args()
    found = compute(3 if chosen.quick else 16, chosen.dask)
    print(found)
    names = {"speed": "belt speed [m/s]", "damping": "damping [N s/m]", "value": "part of the time stuck"}
    plots.sweep_map(found, "speed", "damping", labels=names).figure.savefig(chosen.figure, dpi=300)
