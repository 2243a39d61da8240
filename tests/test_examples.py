"""The examples and scene files: each runs as a program, and a sweep does not depend on where it runs."""

import ast
import importlib
import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from scipy.integrate import solve_ivp

from stickslip import sweep
from stickslip.__main__ import main

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SCENES = sorted((ROOT / "examples" / "scenes").glob("*.*"))
LARGEST_FIGURE = 400_000

SAYS = {
    "abs_wheel": r"ABS: 49\.9860\d+ m; 662 samples\nexact: locked 65\.530799 m",
    "belt_oscillator": r"from far out: 11 events, period 12\.0010310\d+ s",
    "brake_squeal": r"mu = 0\.288675135, exact 0\.288675135\nat mu = 0\.32 it grows by (0\.0475\d+) 1/s, simulated \1",
    "clutch_engagement": r"locked at 1\.0880492\d+ s with 58\.88399\d rad/s",
    "clutch_launch": r"judder at 110\.25 rad/s, by hand 110\.25 rad/s",
    "coupled_clutches": r"0\.7916623\d+ s  clutch1: FORWARD -> STUCK",
    "drill_string": r"the bit sticks 9 times",
    "drum_brake": r"leading: stops at 4\.583333333333 s, exact 4\.583333333333 s",
    "dry_pendulum": r"-1\.86328958\d rad; from the energy -1\.863289581 rad",
    "fit_friction": r"off by [01]\.\d standard errors at most",
    "earthquake_statistics": r"2\d\d\d changes of modes make 5\d\d events",
    "flywheel_brake": r"both wheels turn on with 0\.687838305726 rad/s",
    "four_flywheels": r"dry friction only: 11 events",
    "pid_hunting": r"amplitude 0\.067240146921, exact 0\.067240146921",
    "relaxation": r"(?m)^18 s  floor: STUCK -> FORWARD \(breakaway\)",
    # how far it gets within its time depends on the machine
    "speed_accuracy": r"errors down to \d\.\de-1\d rad/s\n(for an error of 0\.001 rad/s: simulate|recommend: no call)",
    "spring_block_fault": r"\d+ slips of blocks make \d\d events",
    "stick_slip_map": r"sweep of 9 points: 0 failed, 0 pending",
    "thermal_clutch": r"fade 70%: locks at 0\.45060021 s, exact 0\.45060021 s",
}
"""What each example prints, among other lines."""
QUICK = {"speed_accuracy", "stick_slip_map"}
"""Examples that have an option --quick."""
HAND_ON = {"stick_slip_map"}
"""Examples whose functions other processes load: they have to be the program of a process."""


def run(*arguments, folder):
    environment = os.environ | {"MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-W", "error", *map(str, arguments)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def name_of(path):
    return path.stem


def test_every_example_is_tested():
    assert [path.stem for path in EXAMPLES] == sorted(SAYS)


@pytest.mark.slow
@pytest.mark.parametrize("path", EXAMPLES, ids=name_of)
def test_example_runs_headless(path, tmp_path, monkeypatch, capsys):
    figure = tmp_path / "figure.png"
    arguments = [path, figure, *(["--quick"] if path.stem in QUICK else [])]
    if path.stem in HAND_ON:
        said = run(*arguments, folder=tmp_path)
    else:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [str(argument) for argument in arguments])
        runpy.run_path(str(path), run_name="__main__")
        said = capsys.readouterr().out
    assert re.search(SAYS[path.stem], said), said
    assert figure.stat().st_size < LARGEST_FIGURE
    pixels = np.rint(255 * imread(figure)[..., :3])
    assert min(pixels.shape[:2]) > 300
    assert np.unique(pixels @ [65536, 256, 1]).size > 20
    assert [file.name for file in tmp_path.iterdir()] == ["figure.png"]


@pytest.mark.parametrize("path", EXAMPLES, ids=name_of)
def test_example_is_short_and_says_what_it_shows(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 60
    assert len(ast.get_docstring(ast.parse(text))) > 200


@pytest.mark.parametrize("path", EXAMPLES, ids=name_of)
def test_figure_of_the_gallery_is_small(path):
    figure = path.parent / "figures" / f"{path.stem}.png"
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert 10_000 < figure.stat().st_size < LARGEST_FIGURE


def test_there_are_scene_files_of_both_kinds():
    assert {path.suffix for path in SCENES} == {".toml", ".json"}
    assert len(SCENES) >= 5


@pytest.mark.slow
@pytest.mark.parametrize("path", SCENES, ids=name_of)
def test_scene_file_runs(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(path), "--csv", "o.csv", "--json", "o.json"]) == 0
    said = capsys.readouterr().out
    assert "the end of the time span was reached" in said
    assert "STUCK" in said
    assert (tmp_path / "o.csv").stat().st_size > 1000
    assert '"success": true' in (tmp_path / "o.json").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "times", "within"),
    [
        # DOP853 with located events, tolerance 1e-12
        ("planetary_shift", {"brake": 1.2663653360814, "clutch": 1.4553932412582}, 1e-11),
        # a rigid thread, with up = m g r tan(lead + atan(mu)) and J = I + m r^2 tan(lead) tan(lead + atan(mu)):
        # it turns faster by (120 - up) / J for 0.5 s, then slower by up / J
        ("screw_jack", {"flank": 0.6353927628096}, 2e-8),
    ],
)
def test_scene_file_has_the_events_of_an_independent_answer(name, times, within, tmp_path):
    path = tmp_path / "o.json"
    main(["run", str(ROOT / "examples" / "scenes" / f"{name}.toml"), "--json", str(path)])
    events = json.loads(path.read_text(encoding="utf-8"))["events"]
    assert [event["contact"] for event in events] == list(times)
    np.testing.assert_allclose([event["t"] for event in events], list(times.values()), rtol=0, atol=within)


def test_gallery_shows_every_example():
    text = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    for path in EXAMPLES:
        assert f"](figures/{path.stem}.png)" in text
    for path in SCENES:
        assert f"`{path.name}`" in text


@pytest.mark.slow
def test_first_scene_of_the_documentation_runs(tmp_path):
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert "brake: FORWARD -> STUCK" in run("-c", code, folder=tmp_path)
    assert (tmp_path / "brake.png").exists()


# -- the sweep --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def module():
    folder = str(ROOT / "examples")
    sys.path.insert(0, folder)
    yield importlib.import_module("stick_slip_map")
    sys.path.remove(folder)


@pytest.fixture(scope="module")
def serial(module):
    grid = {"speed": np.geomspace(0.05, 1.0, 2), "damping": np.linspace(0.0, 0.8, 2)}
    return sweep(module.stuck_part, grid, executor="serial", progress=False)


def stuck_without_damping(speed):
    """Part of the samples in which a block sticks: it slips as scipy says, and sticks until the spring pulls 0.5 N."""

    def rates(t, y):
        return [y[1], 0.3 + 0.2 * np.exp(-(speed - y[1]) / 0.2) - y[0]]

    def caught_up(t, y):
        return y[1] - speed

    caught_up.terminal, caught_up.direction = True, 1.0
    times, t, y = np.linspace(40.0, 80.0, 2001), 0.0, [0.0, 0.0]
    stuck = np.zeros(times.size, dtype=bool)
    while t < 80.0:
        slip = solve_ivp(rates, (t, t + 99.0), y, events=caught_up, rtol=1e-9, atol=1e-11, max_step=0.1)
        begun, t = slip.t[-1], slip.t[-1] + (0.5 - slip.y[0, -1]) / speed
        stuck |= (times > begun) & (times < t)
        y = [0.5, speed]
    return stuck.mean()


def test_sweep_tells_stick_slip_from_sliding(serial):
    assert not serial.failures
    # each of 2001 samples is one of the two but for those at a change
    assert serial.value()[0, 0] == pytest.approx(stuck_without_damping(0.05), abs=5 / 2001)
    assert serial.value()[1, 1] == 0.0


@pytest.mark.slow
def test_sweep_is_the_same_on_processes(module, serial):
    np.testing.assert_array_equal(module.compute(2, dask=False).value(), serial.value())


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_sweep_is_the_same_on_a_dask_cluster(module, serial):
    pytest.importorskip("distributed")
    np.testing.assert_array_equal(module.compute(2, dask=True).value(), serial.value())
