"""Engines advance a motion to its first event. Each engine is a file, and a line in the registry here."""

from typing import Literal

from stickslip.engines import cvode, fixed_step, ida, series
from stickslip.engines.base import Method

__all__ = ["METHODS", "MethodName"]

# What `simulate` accepts as `method`, for editors and type checkers.
MethodName = Literal["auto", "series", "BDF", "Adams", "RK4", "Euler"]

# Every method by name, as `simulate` takes it. In the multiplier formulation, method "BDF" means IDA.
METHODS: dict[str, Method] = {
    "series": series.SERIES,
    "BDF": cvode.BDF,
    "Adams": cvode.ADAMS,
    "IDA": ida.IDA_BDF,
    "RK4": fixed_step.RK4,
    "Euler": fixed_step.EULER,
}
