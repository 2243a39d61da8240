"""What is loaded only where it is needed, looked up in a new process."""

from __future__ import annotations

import subprocess
import sys

import pytest

LATER = ("sksundae", "scipy.sparse", "scipy.optimize", "matplotlib", "pandas", "xarray", "stickslip.plots")
LOADED = f"import sys; print([name for name in {LATER} if name in sys.modules])"


@pytest.mark.slow
def test_a_small_scene_needs_neither_solvers_nor_sparse_matrices_nor_plots_nor_tables() -> None:
    program = (
        "import stickslip; from stickslip.benchmark import flywheel_benchmark; "
        "result = stickslip.simulate(flywheel_benchmark(), (0.0, 4.0)); result.velocity('wheel1'); " + LOADED
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
