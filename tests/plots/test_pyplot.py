"""Figures are pyplot's where a user draws, so that `plt.show()` shows them; reports and notebooks leave none behind."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from stickslip import Result, plots, simulate, sweep, work_precision
from stickslip.__main__ import main
from stickslip.benchmark import flywheel_benchmark

DRAWN: dict[str, Callable[[Result], Any]] = {
    "result": lambda result: result.plot(),
    "scene": lambda result: result.scene.draw(),
    "velocities": lambda result: plots.velocities(result).figure,
    "modes": lambda result: plots.modes(result).figure,
    "contact_forces": lambda result: plots.contact_forces(result, "brake").figure,
    "normal_forces": lambda result: plots.normal_forces(result).figure,
    "load_of_contacts": lambda result: plots.load_of_contacts(result).figure,
    "phase_portrait": lambda result: plots.phase_portrait(result, "brake").figure,
    "characteristic": lambda result: plots.characteristic(result, "brake").figure,
    "energy": lambda result: plots.energy(result).figure,
    "schematic": lambda result: plots.schematic(result.scene).figure,
}


@pytest.fixture(scope="module")
def wheels() -> Result:
    return simulate(flywheel_benchmark(), (0.0, 1.0))


@pytest.fixture(autouse=True)
def starts_and_ends_without_figures() -> Iterator[None]:
    plt.close("all")
    yield
    plt.close("all")


@pytest.mark.parametrize("name", DRAWN)
def test_what_a_user_draws_is_what_show_shows(name: str, wheels: Result) -> None:
    figure = DRAWN[name](wheels)
    assert isinstance(figure, Figure)
    assert [plt.figure(number) for number in plt.get_fignums()] == [figure]


def test_studies_are_drawn_by_the_same_convention() -> None:
    found = sweep(lambda x, y: x * y, {"x": np.arange(3.0), "y": np.arange(2.0)}, executor="serial")
    table = work_precision({"a": lambda: 1.0, "b": lambda: 2.0}, error=lambda found: found, repeats=1)
    drawn = [plots.sweep_map(found, "x", "y").figure, plots.work_precision(table).figure]
    assert [plt.figure(number) for number in plt.get_fignums()] == drawn


def test_axes_of_a_user_stay_a_users(wheels: Result) -> None:
    figure = Figure()
    plots.velocities(wheels, ax=figure.subplots())
    wheels.scene.draw(ax=figure.add_subplot())
    assert plt.get_fignums() == []


@pytest.mark.parametrize(
    "refused",
    [
        lambda result: result.plot(bodies=["wheel3"]),
        lambda result: result.plot(contacts=["clutch"]),
        lambda result: result.plot(axes=[]),
        lambda result: plots.velocities(result, ["wheel3"]),
        lambda result: plots.modes(result, ["clutch"]),
        lambda result: plots.contact_forces(result, "clutch"),
        lambda result: plots.normal_forces(result, ["clutch"]),
        lambda result: plots.load_of_contacts(result, ["clutch"]),
        lambda result: plots.phase_portrait(result, "clutch"),
        lambda result: plots.characteristic(result, "clutch"),
        lambda result: plots.stretch(result, "clutch"),
        lambda result: plots.block(result, "clutch"),
    ],
)
def test_what_is_refused_leaves_no_empty_figure(refused: Callable[[Result], Any], wheels: Result) -> None:
    with pytest.raises(ValueError, match=r"'wheel3'|'clutch'|panels need as many axes"):
        refused(wheels)
    assert plt.get_fignums() == []


@pytest.mark.slow
def test_pages_and_notebooks_leave_no_figure_behind(wheels: Result, tmp_path: Path) -> None:
    wheels.report(tmp_path / "run.html")
    assert "<svg" in wheels.scene._repr_html_() and "<img" in wheels._repr_html_()
    assert plt.get_fignums() == []
    # also not after one that failed
    with pytest.raises(OSError, match="no-such-folder"):
        wheels.report(tmp_path / "no-such-folder" / "run.html")
    wheels.plot()
    assert len(plt.get_fignums()) == 1


def test_the_command_line_leaves_no_figure_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(
        '[[bodies]]\nname = "block"\ninertia = 1.0\nvelocity = 1.0\n\n[simulation]\nspan = [0.0, 1.0]\n',
        encoding="utf-8",
    )
    assert main(["run", "scene.toml", "--plot", "run.png", "--report", "run.html"]) == 0
    assert main(["draw", "scene.toml"]) == 0
    assert (tmp_path / "run.png").exists() and (tmp_path / "scene.png").exists()
    assert plt.get_fignums() == []


def test_a_notebook_shows_a_figure_once(wheels: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    figure: Any = wheels.plot()
    with pytest.raises(NotImplementedError):  # says that it is shown like any other figure
        figure._ipython_display_()
    assert len(plt.get_fignums()) == 1
    monkeypatch.setattr(plt, "get_backend", lambda: "module://matplotlib_inline.backend_inline")
    with pytest.raises(NotImplementedError):
        figure._ipython_display_()
    assert plt.get_fignums() == []  # or it would be shown again at the end of the cell


@pytest.mark.slow
def test_importing_loads_no_matplotlib_and_pages_no_pyplot(tmp_path: Path) -> None:
    code = (
        "import sys, stickslip; assert 'matplotlib' not in sys.modules;"
        "from stickslip import simulate; from stickslip.benchmark import *;"
        "simulate(flywheel_benchmark(), (0.0, 1.0)).report('run.html');"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False).returncode == 0
    assert (tmp_path / "run.html").exists()
