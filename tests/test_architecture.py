"""What may import what, read off the source: rooms whose imports run one way, and no circles."""

from __future__ import annotations

import ast
import importlib
import inspect
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path

import pytest

import stickslip

PACKAGE = Path(stickslip.__file__).parent
BELOW: dict[str, tuple[str, ...]] = {
    "model": (),
    "equations": ("model",),
    "events": ("model", "equations"),
    "engines": ("model", "equations"),
    "results": ("model", "equations"),
    "plots": ("model", "equations", "results"),
    "simulation": ("model", "equations", "events", "engines", "results", "plots"),
    "studies": ("model", "equations", "events", "engines", "results", "plots", "simulation"),
}
"""Rooms, and those that each may import from besides itself; the command line may import all."""
COMMAND_LINE = {"stickslip", "stickslip.__main__", "stickslip.benchmark"}


def dotted(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = {dotted(path): path for path in sorted(PACKAGE.rglob("*.py"))}
MODULES = list(SOURCES)


def room(module: str) -> str:
    """The folder that a module of the package is in."""
    return "command line" if module in COMMAND_LINE else module.split(".")[1]


@cache
def imports(module: str) -> frozenset[str]:
    """All that a module imports, wherever in its source: lazily and for type checking, too."""
    found = set()
    for node in ast.walk(ast.parse(SOURCES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module is not None, f"{module} imports relatively"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name for name in inner if name in SOURCES}
            if not inner <= SOURCES.keys():
                found.add(node.module)
    return frozenset(found)


def own(module: str) -> list[str]:
    """The modules of the package that a module imports."""
    return sorted(name for name in imports(module) if name in SOURCES)


def importers(library: str) -> set[str]:
    return {m for m in MODULES if any(name.partition(".")[0] == library for name in imports(m))}


def test_the_source_is_read_as_expected() -> None:
    assert "stickslip.model.scene" in imports("stickslip.equations.system")
    # lazily
    assert "stickslip.plots" in imports("stickslip.simulation.presented")
    assert {room(m) for m in MODULES} == {*BELOW, "command line"}


@pytest.mark.parametrize("module", [m for m in MODULES if m not in COMMAND_LINE])
def test_imports_run_one_way(module: str) -> None:
    here = room(module)
    for name in own(module):
        there = room(name)
        assert there == here or there in BELOW[here], f"{module} ({here}) imports {name} ({there})"


def test_no_module_needs_itself() -> None:
    """Neither lazily nor for its types; a room's `__init__` counts as part of what lies in it."""
    done: set[str] = set()

    def visit(module: str, path: tuple[str, ...]) -> None:
        assert module not in path, " -> ".join((*path[path.index(module) :], module))
        if module not in done:
            for name in own(module):
                visit(name, (*path, module))
            done.add(module)

    for module in MODULES:
        visit(module, ())


def test_every_room_says_what_it_is() -> None:
    for name in BELOW:
        assert inspect.getdoc(importlib.import_module(f"stickslip.{name}")), name


def test_one_module_imports_sundials_for_the_engines() -> None:
    assert importers("sksundae") == {"stickslip.engines.solvers.sundials"}
    users = {m for m in MODULES if "stickslip.engines.solvers.sundials" in imports(m)}
    assert {room(m) for m in users} == {"engines"}


def test_only_the_plots_import_matplotlib() -> None:
    assert "stickslip.plots.style" in importers("matplotlib")
    assert {room(m) for m in importers("matplotlib")} == {"plots"}


def test_tables_and_arrays_of_others_are_imported_only_when_asked_for() -> None:
    for library in ("pandas", "xarray"):
        for module in importers(library):
            for node in ast.parse(SOURCES[module].read_text(encoding="utf-8")).body:
                if isinstance(node, (ast.Import, ast.ImportFrom)):
                    assert library not in ast.unparse(node), module


def test_studies_of_any_function_know_no_friction() -> None:
    for name in ("work_precision", "table", "sweeps", "sweep_data"):
        known = {m for m in own(f"stickslip.studies.{name}") if room(m) not in ("studies", "plots")}
        known.discard("stickslip.model.checks")
        assert not known, f"{name} imports {', '.join(known)}"


@pytest.mark.parametrize("module", [m for m in MODULES if m != "stickslip.__main__"])
def test_what_is_public_exists_and_is_described(module: str) -> None:
    loaded = importlib.import_module(module)
    assert inspect.getdoc(loaded), module
    for name, thing in vars(loaded).items():
        is_own = not name.startswith("_") and getattr(thing, "__module__", None) == module
        if is_own and (inspect.isclass(thing) or inspect.isfunction(thing)):
            described = thing.__doc__ or ""
            # dataclasses without a docstring get their signature for one
            assert described and not described.startswith(f"{name}("), f"{module}.{name} has no docstring"


COUNTERS_AND_DRAFTS = {"Work", "Form", "_Record"}
"""What counts, and what is put together piece by piece."""


def test_data_is_frozen() -> None:
    open_ones = set()
    for name in MODULES:
        if name == "stickslip.__main__":
            continue
        for thing in vars(importlib.import_module(name)).values():
            if is_dataclass(thing) and isinstance(thing, type) and thing.__module__ == name:
                open_ones |= set() if thing.__dataclass_params__.frozen else {thing.__name__}  # type: ignore[attr-defined]
    assert open_ones == COUNTERS_AND_DRAFTS
