"""What may import what, read off the source: imports run downwards only."""

import ast
import importlib
import inspect
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

import stickslip

PACKAGE = Path(stickslip.__file__).parent
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py"))
FLOORS = (
    ("checks", "modes", "signal_kinds", "signals", "laws", "regularized"),
    ("elements", "scene", "loads", "grouping"),
    ("friction", "mode_set", "assembly", "motion", "segment", "scan"),
    ("transitions", "result"),
    ("engine", "integrate", "energy", "explain", "output"),
    ("study", "sweeps", "sweep_data", "tradeoff"),
    ("plots",),
    ("__init__",),
    ("__main__",),
)
MAY_BE_LAZY = ("plots", "energy", "explain", "output")
"""What functions of lower floors may import when they are called."""
LONGEST = 460


@dataclass(frozen=True)
class Import:
    module: str
    lazy: bool


@cache
def floor(module: str) -> int:
    """Modules are on the floor that lists them or the module they are named after, else on that of their imports."""
    for name in (module, module.partition("_")[0]):
        for height, names in enumerate(FLOORS):
            if name in names:
                return height
    return max((floor(i.module) for i in own(module) if not i.lazy), default=0)


def family(module: str, names: tuple[str, ...]) -> bool:
    return any(module == name or module.startswith(f"{name}_") for name in names)


def statements(node: ast.AST, lazy: bool = False) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """All imports but those made for type checking only."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            yield child, lazy
        elif not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield from statements(child, lazy or isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)))


@cache
def imports(module: str) -> tuple[Import, ...]:
    """What a module imports: modules of the package by their short names, others by their full ones."""
    found = []
    for node, lazy in statements(ast.parse((PACKAGE / f"{module}.py").read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            assert node.level == 0, f"{module} imports relatively"
            assert node.module is not None
            names = [node.module]
            if node.module == "stickslip":
                names = [
                    f"stickslip.{a.name}" if a.name in MODULES else "stickslip.__init__" for a in node.names
                ]
        for name in names:
            found.append(Import(name.removeprefix("stickslip."), lazy))
    return tuple(found)


def own(module: str) -> list[Import]:
    return [i for i in imports(module) if i.module in MODULES]


def importers(library: str) -> set[str]:
    return {m for m in MODULES if any(i.module.partition(".")[0] == library for i in imports(m))}


def test_the_source_is_read_as_expected() -> None:
    assert Import("scene", False) in imports("assembly")
    assert Import("plots", True) in imports("result")
    assert not any(i.module.startswith("matplotlib") for i in imports("result"))


@pytest.mark.parametrize("module", MODULES)
def test_imports_run_downwards(module: str) -> None:
    for i in own(module):
        if floor(i.module) > floor(module):
            assert i.lazy, f"{module} imports {i.module}, which is above it"
            assert family(i.module, MAY_BE_LAZY), f"{module} imports {i.module} from above within a function"


def test_no_module_needs_itself() -> None:
    done: set[str] = set()

    def visit(module: str, path: tuple[str, ...]) -> None:
        assert module not in path, " -> ".join((*path, module))
        if module not in done:
            for i in own(module):
                if not i.lazy:
                    visit(i.module, (*path, module))
            done.add(module)

    for module in MODULES:
        visit(module, ())


def test_one_module_imports_sundials_for_the_engines() -> None:
    assert importers("sksundae") == {"engine_sundials"}
    assert all(family(m, ("engine",)) for m in importers("engine_sundials"))


def test_only_the_plots_import_matplotlib() -> None:
    assert "plots_style" in importers("matplotlib")
    assert all(family(m, ("plots",)) for m in importers("matplotlib"))


def test_tables_and_arrays_of_others_are_imported_only_when_asked_for() -> None:
    for library in ("pandas", "xarray"):
        for module in importers(library):
            assert all(i.lazy for i in imports(module) if i.module.partition(".")[0] == library), module


def test_studies_know_no_friction() -> None:
    for module in ("study", "study_table", "sweeps", "sweep_data"):
        known = {i.module for i in own(module)}
        assert known <= {"study", "study_table", "sweeps", "sweep_data", "plots", "plots_study"}, module


def test_importing_the_package_loads_no_plots_and_no_tables() -> None:
    code = "import stickslip, sys; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "stickslip.simulation.simulate" in loaded
    for library in ("matplotlib", "pandas", "xarray", "stickslip.plots"):
        assert library not in loaded


@pytest.mark.parametrize("module", [m for m in MODULES if m != "__main__"])
def test_what_is_public_exists_and_is_described(module: str) -> None:
    loaded = importlib.import_module("stickslip" if module == "__init__" else f"stickslip.{module}")
    assert inspect.getdoc(loaded), module
    for name in getattr(loaded, "__all__", []):
        thing = getattr(loaded, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            described = thing.__doc__ or ""
            # dataclasses without a docstring get their signature for one
            assert described and not described.startswith(f"{name}("), f"{module}.{name} has no docstring"


@pytest.mark.parametrize("module", MODULES)
def test_no_file_grows_too_long(module: str) -> None:
    lines = (PACKAGE / f"{module}.py").read_text().count("\n")
    assert lines <= LONGEST, f"{module}.py has {lines} lines: it wants to be two things"
