"""Drawings of results and studies.

Each takes a result, the names of what to draw of it, and `ax`, the axes of matplotlib to draw on: by default those of a
new figure of pyplot. It returns the axes. A name that the scene does not know raises a ValueError; an argument that is
no result or no axes raises a TypeError.

This module and its parts are the only ones that load matplotlib.
"""

from __future__ import annotations

from matplotlib.figure import Figure as Figure

from stickslip.plots.bifurcation import bifurcation
from stickslip.plots.blocks import block
from stickslip.plots.contact import characteristic, contact_forces, load_of_contacts, normal_forces, phase_portrait
from stickslip.plots.energy import energy
from stickslip.plots.fit import fit
from stickslip.plots.limits import stretch
from stickslip.plots.motion import modes, velocities
from stickslip.plots.overview import overview
from stickslip.plots.schematic import schematic
from stickslip.plots.sweep_map import sweep_map
from stickslip.plots.work_precision import work_precision

__all__ = [
    "Figure",
    "bifurcation",
    "block",
    "characteristic",
    "contact_forces",
    "energy",
    "fit",
    "load_of_contacts",
    "modes",
    "normal_forces",
    "overview",
    "phase_portrait",
    "schematic",
    "stretch",
    "sweep_map",
    "velocities",
    "work_precision",
]
