"""Advance a motion to its first event. The registry of methods: an engine's file and a line here each."""

from typing import Literal

from stickslip.engines import cvode, fixed_step, ida, series
from stickslip.engines.base import Method

__all__ = ["METHODS", "MethodName"]

# What `simulate` takes, for editors and type checkers.
MethodName = Literal["auto", "series", "BDF", "Adams", "RK4", "Euler"]

# Every method by name, as `simulate` takes it; IDA is what BDF is in the multiplier formulation.
METHODS: dict[str, Method] = {
    "series": series.SERIES,
    "BDF": cvode.BDF,
    "Adams": cvode.ADAMS,
    "IDA": ida.IDA_BDF,
    "RK4": fixed_step.RK4,
    "Euler": fixed_step.EULER,
}
