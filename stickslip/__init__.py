"""Dry friction simulated with exact sticking and exact events, on SUNDIALS CVODE and IDA."""

from stickslip.explain import explain
from stickslip.integrate import simulate
from stickslip.laws import DryFriction
from stickslip.modes import Mode
from stickslip.output import load
from stickslip.regularized import Dahl, Karnopp, LuGre, PreSlip
from stickslip.result import Event, Result, SimulationError, SimulationInterrupted
from stickslip.scene import GROUND, Body, Contact, Damper, Drive, Force, Scene, Spring
from stickslip.signals import Signal, piecewise_linear, signal, sine, step, triangle
from stickslip.study import work_precision
from stickslip.sweeps import sweep
from stickslip.tradeoff import tradeoff

__all__ = [
    "GROUND",
    "Body",
    "Contact",
    "Dahl",
    "Damper",
    "Drive",
    "DryFriction",
    "Event",
    "Force",
    "Karnopp",
    "LuGre",
    "Mode",
    "PreSlip",
    "Result",
    "Scene",
    "Signal",
    "SimulationError",
    "SimulationInterrupted",
    "Spring",
    "explain",
    "load",
    "piecewise_linear",
    "signal",
    "simulate",
    "sine",
    "step",
    "sweep",
    "tradeoff",
    "triangle",
    "work_precision",
]
__version__ = "0.1.0"
