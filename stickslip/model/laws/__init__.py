"""Friction laws as frozen data, each with its forces: a file and a line here each."""

from stickslip.model.laws.dahl import Dahl
from stickslip.model.laws.dry_friction import DryFriction, Law, register
from stickslip.model.laws.karnopp import Karnopp
from stickslip.model.laws.lugre import LuGre
from stickslip.model.laws.pre_slip import PreSlip, Shape

__all__ = ["Dahl", "DryFriction", "Karnopp", "Law", "LuGre", "PreSlip", "Shape", "register"]
