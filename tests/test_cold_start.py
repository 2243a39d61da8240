"""What is loaded only where it is needed."""

from __future__ import annotations

import subprocess
import sys

LOADED = (
    "import sys; print([name for name in ('sksundae', 'scipy.sparse', 'scipy.optimize', 'matplotlib') "
    "if name in sys.modules])"
)


def test_a_small_scene_needs_neither_solvers_nor_sparse_matrices() -> None:
    program = (
        "import stickslip; from stickslip.benchmark import flywheel_benchmark; "
        "result = stickslip.simulate(flywheel_benchmark(), (0.0, 4.0)); result.velocity('wheel1'); " + LOADED
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
