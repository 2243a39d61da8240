"""Dry friction simulated with exact sticking and exact events, on SUNDIALS CVODE and IDA."""

from stickslip.model.elements import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    Force,
    Gap,
    Gear,
    OneWay,
    Planetary,
    Spring,
    Stop,
    Tie,
)
from stickslip.model.laws import Dahl, DryFriction, Karnopp, LuGre, PreSlip
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.model.signal_makers import Signal, piecewise_linear, signal, sine, step, triangle
from stickslip.results import files as output
from stickslip.results.outcome import Event
from stickslip.simulation.explain import explain
from stickslip.simulation.result import Result, SimulationError, SimulationInterrupted, load
from stickslip.simulation.showing import attach as _let_scenes_show_themselves
from stickslip.simulation.simulate import simulate
from stickslip.studies.cycles import Cycle, CycleError, limit_cycle
from stickslip.studies.sensitivities import Sensitivities, sensitivities
from stickslip.studies.sweeps import sweep
from stickslip.studies.tradeoff import tradeoff
from stickslip.studies.work_precision import work_precision

__all__ = [
    "GROUND",
    "Body",
    "Contact",
    "Cycle",
    "CycleError",
    "Dahl",
    "Damper",
    "Drive",
    "DryFriction",
    "Event",
    "Force",
    "Gap",
    "Gear",
    "Karnopp",
    "LuGre",
    "Mode",
    "OneWay",
    "Planetary",
    "PreSlip",
    "Result",
    "Scene",
    "Sensitivities",
    "Signal",
    "SimulationError",
    "SimulationInterrupted",
    "Spring",
    "Stop",
    "Tie",
    "explain",
    "limit_cycle",
    "load",
    "output",
    "piecewise_linear",
    "sensitivities",
    "signal",
    "simulate",
    "sine",
    "step",
    "sweep",
    "tradeoff",
    "triangle",
    "work_precision",
]
__version__ = "0.2.0"

_let_scenes_show_themselves()
