"""Dry friction simulated with exact sticking and exact events, by Taylor series and SUNDIALS' CVODE and IDA."""

from stickslip.model.controllers import pid
from stickslip.model.elements import (
    GROUND,
    Block,
    Body,
    Contact,
    Damper,
    Drive,
    Force,
    Gap,
    Gear,
    OneWay,
    Planetary,
    Sampled,
    Spring,
    StateSpace,
    Stop,
    Tie,
)
from stickslip.model.laws import Dahl, DryFriction, Karnopp, LuGre, PreSlip
from stickslip.model.modes import Mode
from stickslip.model.quantities import (
    TIME,
    Quantity,
    feedback,
    normal,
    position,
    power,
    relative_velocity,
    saturate,
    stretch,
    table,
    velocity,
)
from stickslip.model.scene import Scene
from stickslip.model.signal_makers import piecewise_linear, signal, sine, step, triangle
from stickslip.model.signals import Signal
from stickslip.model.when import When
from stickslip.results.outcome import Event
from stickslip.results.output import output
from stickslip.simulation.explain import explain
from stickslip.simulation.joined import Joined, join
from stickslip.simulation.load import load
from stickslip.simulation.result import Result, SimulationError, SimulationInterrupted
from stickslip.simulation.showing import let_scenes_show_themselves as _let_scenes_show_themselves
from stickslip.simulation.simulate import simulate
from stickslip.studies.cycles.branches import Branch
from stickslip.studies.cycles.continuation import continue_cycle
from stickslip.studies.cycles.cycle import Cycle
from stickslip.studies.cycles.search import limit_cycle
from stickslip.studies.cycles.shooting import CycleError
from stickslip.studies.derivatives.sensitivities import Sensitivities, sensitivities
from stickslip.studies.fits.fit import fit
from stickslip.studies.fits.fitted import Fit
from stickslip.studies.linear_model import LinearModel, linearize
from stickslip.studies.sweeps import sweep
from stickslip.studies.tradeoff import tradeoff
from stickslip.studies.work_precision import work_precision

__all__ = [
    "GROUND",
    "TIME",
    "Block",
    "Body",
    "Branch",
    "Contact",
    "Cycle",
    "CycleError",
    "Dahl",
    "Damper",
    "Drive",
    "DryFriction",
    "Event",
    "Fit",
    "Force",
    "Gap",
    "Gear",
    "Joined",
    "Karnopp",
    "LinearModel",
    "LuGre",
    "Mode",
    "OneWay",
    "Planetary",
    "PreSlip",
    "Quantity",
    "Result",
    "Sampled",
    "Scene",
    "Sensitivities",
    "Signal",
    "SimulationError",
    "SimulationInterrupted",
    "Spring",
    "StateSpace",
    "Stop",
    "Tie",
    "When",
    "continue_cycle",
    "explain",
    "feedback",
    "fit",
    "join",
    "limit_cycle",
    "linearize",
    "load",
    "normal",
    "output",
    "pid",
    "piecewise_linear",
    "position",
    "power",
    "relative_velocity",
    "saturate",
    "sensitivities",
    "signal",
    "simulate",
    "sine",
    "step",
    "stretch",
    "sweep",
    "table",
    "tradeoff",
    "triangle",
    "velocity",
    "work_precision",
]
__version__ = "0.2.0"

_let_scenes_show_themselves()
