"""What is shipped: metadata, types that other programs can rely on, an API page with every public name."""

from __future__ import annotations

import importlib
import importlib.metadata
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

import stickslip

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
API = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")

DOWNSTREAM = """
import numpy as np
from numpy.typing import NDArray

import stickslip
from stickslip import (
    GROUND, Body, Contact, Damper, Drive, DryFriction, Event, Force, Mode, Result, Scene, Signal, Spring,
    explain, piecewise_linear, plots, signal, simulate, sine, step, sweep, tradeoff, triangle,
)

times: NDArray[np.float64] = np.linspace(0.0, 1.0, 11)
load: Signal = piecewise_linear(times, times) + 2 * triangle(0.0, 1.0, 2.0, slope=3) - sine(1, 2) + step(1)
scene: Scene = Scene(
    Body("wheel", inertia=1, velocity=np.float64(2.0)),
    Body("car", inertia=10),
    Drive("belt", velocity=signal(lambda t: t * t, period=1.0)),
    Contact("tyre", "wheel", "car", DryFriction(0.2, 0.1, dwell=0.1), normal=100, radius_a=0.3),
    Contact("rub", "car", GROUND, DryFriction(0.2, 0.1), normal=load),
    Spring("car", "belt", stiffness=3),
    Damper("car", GROUND, damping=1),
    Force("wheel", piecewise_linear([0, 1], (0, 2))),
    motion="rotation",
)
result: Result = simulate(scene, (0, 1), method="BDF", formulation="merged", t_eval=times, rtol=1e-6)
result = simulate(scene, np.array([0.0, 1.0]), t_eval=[0, 0.5, 1])
result = simulate(scene, [0, 1], t_eval=range(2))
velocity: NDArray[np.float64] = result.velocity("wheel")
modes: NDArray[np.int8] = result.mode("rub")
states: list[NDArray[np.float64]] = [result(times), result([0.1, 0.2]), result(0.5)]
chosen: list[Result] = [result.sample(101), result.sample([0, 1]), result.sample(times)]
events: list[Event] = result.events
share: dict[Mode, float] = result.share("rub")
heat: NDArray[np.float64] = result.energy().heat
words: str = explain(scene, (0, 1)) + explain(result) + result.explain()
bodies: list[str] = [body.name for body in scene.bodies]
table: dict[str, NDArray[np.float64]] = stickslip.output.columns(result)
result.to_csv("run.csv", units=True)
result.report("run.html", title="run")
result.plot(t_span=(0, 1)).savefig("run.png")
scene.draw().savefig("scene.svg")
plots.velocities(result, ["wheel"])
advice: str = str(tradeoff(scene, (0, 1), budget=1.0).recommend(error=1e-3))
values: NDArray[np.float64] = sweep(lambda x: x**2, {"x": times}, executor="serial").value()
again: Scene = Scene.from_dict(scene.replace("car", inertia=2).to_dict())
"""
WRONG = [
    ('simulate(scene, (0, 1), method="LSODA")', 'Argument "method" to "simulate" has incompatible type'),
    ('simulate(scene, (0, 1), formulation="merge")', 'Argument "formulation" to "simulate" has incompatible'),
    ('Scene(motion="spin")', 'Argument "motion" to "Scene" has incompatible type'),
    ('Body("a", inertia="1")', 'Argument "inertia" to "Body" has incompatible type'),
    ("simulate(scene)", 'Missing positional argument "t_span"'),
]


def test_the_version_stands_once_in_three_places() -> None:
    assert PROJECT["version"] == stickslip.__version__
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (\d+\.\d+\.\d+)", changelog, flags=re.MULTILINE)
    assert newest is not None and newest[1] == stickslip.__version__


def test_an_installed_copy_says_the_same_version() -> None:
    try:
        installed = importlib.metadata.version("stickslip")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("not installed, only on the path")
    assert installed == stickslip.__version__


def test_the_metadata_says_what_the_package_is() -> None:
    kinds = " ".join(PROJECT["classifiers"])
    for words in ("Typing :: Typed", "Python :: 3.11", "Scientific/Engineering :: Physics", "OS Independent"):
        assert words in kinds
    assert PROJECT["urls"]


def test_types_are_shipped() -> None:
    assert (Path(stickslip.__file__).parent / "py.typed").exists()


@pytest.mark.parametrize("name", [n for n in stickslip.__all__ if n != "output"])
def test_every_public_name_has_an_entry_of_its_own(name: str) -> None:
    assert re.search(rf"^::: stickslip\.{name}$", API, flags=re.MULTILINE), name


@pytest.mark.parametrize("module", ["plots", "output"])
def test_every_name_of_the_public_modules_has_an_entry(module: str) -> None:
    thing = stickslip.output if module == "output" else importlib.import_module("stickslip.plots")
    names = thing.__all__ if module == "plots" else [name for name in vars(type(thing)) if not name.startswith("_")]
    for name in sorted({*names} - {"Figure", "read"}):
        assert re.search(rf"^::: stickslip\.(plots|results\.(files|tables))\.{name}$", API, flags=re.MULTILINE), name


def checked(code: str, folder: Path) -> str:
    """What mypy says of a program that uses the package."""
    (folder / "program.py").write_text(code, encoding="utf-8")
    pytest.importorskip("mypy")
    options = ["--strict", "--follow-imports=silent", "--no-error-summary", f"--cache-dir={folder / 'cache'}"]
    # the package's own configuration is not that of its users
    command = [sys.executable, "-m", "mypy", "--config-file=", *options, "program.py"]
    environment = os.environ | {"MYPYPATH": str(ROOT)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


@pytest.mark.slow
def test_a_strict_type_check_passes_a_program_and_finds_wrong_arguments(tmp_path: Path) -> None:
    """All messages of mypy are about the wrong calls, which stand at the end."""
    said = checked(DOWNSTREAM + "\n".join(code for code, _ in WRONG), tmp_path)
    right = DOWNSTREAM.count("\n")
    lines = [int(line) for line in re.findall(r"^program\.py:(\d+): ", said, flags=re.MULTILINE)]
    assert len(lines) == len(said.splitlines()) and min(lines) > right, said
    for _, message in WRONG:
        assert message in said
    assert said.count(": error:") == len(WRONG)
