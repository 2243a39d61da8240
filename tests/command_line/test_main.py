"""The command line: exit codes, files, and messages that say what to change."""

import csv
import json
import os
import re
import subprocess
import sys

import pytest
from clocks import count_work

from stickslip import Body, Force, Scene, __version__, load, simulate
from stickslip.__main__ import main
from stickslip.benchmark import (
    EXACT_EVENTS,
    EXACT_FINAL_VELOCITY,
    flywheel_benchmark,
    flywheel_chain,
    four_flywheels,
)
from validation.exact import reference

SCENE = """
[simulation]
span = [0, 4]

[[bodies]]
name = "block"
inertia = 1.0

[[drives]]
name = "belt"
velocity = 0.1

[[springs]]
a = "block"
b = "belt"
stiffness = 2.0

[[contacts]]
name = "floor"
a = "block"
b = "ground"
normal = 1.0
law = { mu_static = 0.15, mu_coulomb = 0.1 }
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


# -- the benchmark ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_benchmark_prints_events_beside_exact_ones_and_draws(here, capsys):
    assert main([]) == 0
    text = capsys.readouterr().out
    assert "interface STUCK -> BACKWARD      0.47300676257614" in text
    errors = [float(line.split()[-1]) for line in text.splitlines() if re.search(r" -> |at the end", line)]
    assert len(errors) == 7
    assert max(map(abs, errors)) < 1e-12
    assert "times faster than real time" in text
    assert "states 2" in text
    # the errors of the engines at the default tolerances: roundoff, or 1e-8 of velocities
    rows = re.findall(r"^(.+?) +the same +(\S+) s +(\S+) rad/s +(\S+) ms +(\S+) ms$", text, re.MULTILINE)
    assert [row[0] for row in rows] == ["Taylor series", "CVODE BDF", "CVODE Adams", "IDA BDF"]
    for name, late, off, *_ in rows:
        assert float(late) < (1e-14 if name == "Taylor series" else 1e-8)
        assert float(off) < (1e-14 if name == "Taylor series" else 1e-8)
    assert (here / "stickslip-benchmark.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_benchmark_options(here, capsys, monkeypatch):
    monkeypatch.setattr("stickslip.__main__._REPEATS", 1)  # the times do not matter here
    assert main(["--no-plot", "--rtol", "1e-6", "--atol", "1e-8"]) == 0
    assert not list(here.glob("*.png"))
    assert main(["--plot", "other.svg"]) == 0
    assert (here / "other.svg").exists()
    assert main(["--no-plot", "--rtol", "7"]) == 2
    assert "rtol must lie between" in capsys.readouterr().err
    assert main(["--plot", "nowhere/x.png"]) == 2
    assert "there is no folder nowhere; make it first" in capsys.readouterr().err


def test_benchmark_scenes_are_the_references():
    for scene, known in ((flywheel_benchmark(), "flywheels-2"), (four_flywheels(), "flywheels-4")):
        exact = reference(known).scene
        assert scene.bodies == exact.bodies
        assert scene.contacts[:-1] == exact.contacts[:-1]
        brake, other = scene.contacts[-1].normal, exact.contacts[-1].normal
        assert brake.times == other.times
        assert brake.values == pytest.approx(other.values, rel=1e-14)
    known = reference("flywheels-2").events
    assert [e.t for e in EXACT_EVENTS] == pytest.approx([event[0] for event in known], rel=1e-15)
    assert [(e.contact, e.before, e.after) for e in EXACT_EVENTS] == [event[1:] for event in known]
    assert reference("flywheels-2").velocities[-1] == pytest.approx(EXACT_FINAL_VELOCITY, abs=1e-16)


def test_four_flywheels_with_viscous_friction_match_the_reference():
    known = reference("flywheels-4-viscous")
    result = simulate(four_flywheels(viscous=5.0), (0.0, known.stop), rtol=1e-10, atol=1e-12)
    assert [(e.contact, e.before, e.after) for e in result.events] == [event[1:] for event in known.events]
    assert [e.t for e in result.events] == pytest.approx([event[0] for event in known.events], abs=1e-8)


def test_chains():
    chain = flywheel_chain(12, viscous=1.0)
    assert [body.name for body in chain.bodies][::11] == ["w1", "w12"]
    assert [contact.name for contact in chain.contacts][::11] == ["c1-2", "brake"]
    assert len(chain.dampers) == 11
    assert chain.contacts[0].normal.value > chain.contacts[10].normal.value > 0
    assert len(flywheel_chain(1).contacts) == 1
    with pytest.raises(ValueError, match="n must be a whole number from 1 on, got 0"):
        flywheel_chain(0)
    with pytest.raises(ValueError, match="normals must have 2 entries, got 3"):
        flywheel_chain(3, normals=[1.0, 2.0, 3.0])


# -- scene files ------------------------------------------------------------------------------------------


def test_run_writes_what_is_asked_for(here, capsys):
    arguments = ["--csv", "o.csv", "--json", "o.json", "--plot", "o.png", "--save", "o.npz"]
    assert main(["run", "scene.toml", *arguments]) == 0
    text = capsys.readouterr().out
    assert "0.75 s  floor: STUCK -> FORWARD (breakaway)" in text
    assert "block: 0.0764764" in text
    result = load(here / "o.npz")
    with (here / "o.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == result.t.size
    assert float(rows[-1]["velocity block"]) == result.velocity("block")[-1]
    data = json.loads((here / "o.json").read_text())
    assert data["events"][0]["t"] == pytest.approx(0.75)
    assert (here / "o.png").stat().st_size > 1000


def test_run_reads_json_and_the_command_line_wins(here, capsys):
    data = flywheel_benchmark().to_dict() | {"simulation": {"span": [0, 4], "points": 3, "rtol": 1e-6}}
    (here / "scene.json").write_text(json.dumps(data))
    assert main(["run", "scene.json", "--span", "0", "1", "--points", "5", "--csv", "o.csv"]) == 0
    with (here / "o.csv").open() as file:
        assert [row["time"] for row in csv.DictReader(file)] == ["0.0", "0.25", "0.5", "0.75", "1.0"]
    assert capsys.readouterr().out.count("->") == 5


def test_run_passes_every_option_on(here, monkeypatch):
    seen = {}

    def fake(scene, span, **options):
        seen.update(options, span=span)
        return simulate(scene, span)

    monkeypatch.setattr("stickslip.__main__.simulate", fake)
    options = ["--span", "-1", "2", "--method", "RK4", "--step", "0.01", "--formulation", "merged"]
    options += ["--max-step", "0.1", "--velocity-margin", "1e-5"]
    assert main(["run", "scene.toml", *options, "--rtol", "1e-5", "--atol", "1e-7", "--progress"]) == 0
    assert seen == {
        "span": [-1.0, 2.0],
        "method": "RK4",
        "step": 0.01,
        "formulation": "merged",
        "rtol": 1e-5,
        "atol": 1e-7,
        "max_step": 0.1,
        "velocity_margin": 1e-5,
        "progress": True,
    }


def test_progress_goes_to_stderr_when_asked(here, capsys):
    assert main(["run", "scene.toml"]) == 0
    assert "simulated" not in capsys.readouterr().err
    assert main(["run", "scene.toml", "--progress"]) == 0
    assert "simulated" in capsys.readouterr().err


@pytest.mark.slow
def test_run_writes_a_report(here):
    assert main(["run", "scene.toml", "--report", "o.html"]) == 0
    assert (here / "o.html").read_text().startswith("<!DOCTYPE html>")


def test_explain_names_the_engine(here, capsys):
    assert main(["explain", "scene.toml"]) == 0
    assert "Engine: Taylor series, because" in capsys.readouterr().out
    assert main(["explain", "scene.toml", "--span", "2", "1"]) == 2
    assert "must run forward" in capsys.readouterr().err


@pytest.mark.slow
def test_sweep_reads_each_point_of_a_grid(here, capsys):
    vary = ["--vary", "floor.normal=1,2", "--vary", "springs[0].stiffness=1:4:3:log"]
    files = ["--csv", "o.csv", "--plot", "o.png", "--value", "stuck floor", "--save", "o.jsonl"]
    assert main(["sweep", "scene.toml", *vary, *files, "--workers", "1"]) == 0
    assert "sweep of 6 points: 0 failed" in capsys.readouterr().out
    with (here / "o.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["floor.normal [N]"] for row in rows] == ["1.0"] * 3 + ["2.0"] * 3
    assert [float(row["springs[0].stiffness [N/m | N m/rad]"]) for row in rows[:3]] == pytest.approx([1, 2, 4])
    # the spring is stretched by 0.1 m/s t and lets go at 0.15 normal / stiffness
    for row in rows:
        k, normal = float(row["springs[0].stiffness [N/m | N m/rad]"]), float(row["floor.normal [N]"])
        assert float(row["stuck floor"]) >= 0.15 * normal / k / 0.1 / 4.0 - 1e-9
    assert (here / "o.png").exists()
    assert len((here / "o.jsonl").read_text().splitlines()) == 6


@pytest.mark.parametrize("change", ["scene", "span", "rtol"])
def test_a_saved_sweep_of_another_scene_or_other_options_is_refused(here, capsys, change):
    arguments = ["sweep", "scene.toml", "--vary", "floor.normal=1,2", "--workers", "1", "--save", "o.jsonl"]
    assert main(arguments) == 0
    before, told = (here / "o.jsonl").read_bytes(), capsys.readouterr().out
    assert main(arguments) == 0
    assert capsys.readouterr().out == told
    if change == "scene":
        text = (here / "scene.toml").read_text()
        (here / "scene.toml").write_text(text.replace("stiffness = ", "stiffness = 1"))
    others = {"scene": [], "span": ["--span", "0", "2"], "rtol": ["--rtol", "1e-4"]}
    assert main([*arguments, *others[change]]) == 2
    assert "saved of another function (scene, time span, options)" in capsys.readouterr().err
    assert (here / "o.jsonl").read_bytes() == before


def test_a_sweep_with_points_that_fail_exits_with_1(here, capsys):
    assert main(["sweep", "scene.toml", "--vary", "block.inertia=1,-1", "--workers", "1"]) == 1
    assert "1 failed" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["floor.normal"], "write FIELD=VALUES, such as floor.normal=1,5,10"),
        (["floor.normal=a,b"], "'a,b' lists no values, or more than 1e+07; write 0.1,0.2,0.5 or START:STOP:COUNT"),
        (["floor.normal=1:2:1000000000000"], "lists no values, or more than 1e+07"),
        (["floor.normal=1:2"], "lists no values"),
        (["floor.normal=0:1:3:log"], "lists"),
        (
            ["wall.normal=1"],
            "begins with no element's name; write 'NAME.field' with one of 'belt', 'block', 'floor'",
        ),
        (["floor=1"], "begins with no element's name"),
        (["floor.norm=1"], "floor.norm"),
        (["floor.normal.slope=1"], "floor.normal.slope"),
        (["springs[3].stiffness=1"], "the scene has 1 springs, counted from 0"),
        (["block.inertia=-1"], "inertia must be positive"),
        (["floor.normal=nan"], "a load must be finite, got nan"),
        (["floor.normal=1e999"], "a load must be finite, got inf"),
        (["floor.normal=1", "--vary", "floor.normal=2"], "stands twice; list all its values at once"),
        (["floor.normal=1,2", "--plot", "o.png"], "--plot draws a map over two fields, but 1 vary"),
        (["floor.normal=1,2", "--csv", "none/o.csv"], "there is no folder none"),
        (["floor.normal=1,2", "--save", "."], "--save .: this is a folder; name a file"),
        (["floor.normal=-1:2:3:log"], "with :log both ends must be positive"),
        (["floor.normal=1,2", "--value", "heat flor"], "choose from events, velocity block, stuck floor, heat floor"),
        (["block.inertia=-1,-2", "--vary", "floor.normal=1,2"], "inertia must be positive"),
    ],
)
def test_bad_sweeps_exit_with_2_and_say_what_to_change(here, capsys, arguments, message):
    assert main(["sweep", "scene.toml", "--workers", "1", "--vary", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_figure_of_no_known_format_is_refused_before_the_points_are_run(here, capsys):
    varied = ["--vary", "floor.normal=1,2", "--vary", "block.inertia=1,2"]
    files = ["--csv", "points.csv", "--plot", "map.xlsx"]
    assert main(["sweep", "scene.toml", "--workers", "1", *varied, *files]) == 2
    assert "no figure can be written as .xlsx" in capsys.readouterr().err
    assert not (here / "points.csv").exists()


@pytest.mark.parametrize("values", ["-1,1", "1,-1"])
def test_a_value_that_cannot_be_is_one_failed_point(here, capsys, values):
    assert main(["sweep", "scene.toml", "--workers", "1", "--vary", f"block.inertia={values}"]) == 1
    text = capsys.readouterr().out
    assert "sweep of 2 points: 1 failed" in text
    assert "failed at block.inertia=-1.0" in text


def test_fields_that_are_possible_only_together_are_varied_together(here, capsys):
    """Each value alone contradicts the law of the file."""
    laws = ["--vary", "floor.law.mu_static=0.05,0.08", "--vary", "floor.law.mu_coulomb=0.01,0.02"]
    assert main(["sweep", "scene.toml", "--workers", "1", *laws]) == 0
    assert "sweep of 4 points: 0 failed" in capsys.readouterr().out


@pytest.mark.slow
def test_tradeoff_measures_and_recommends(here, capsys, monkeypatch):
    count_work(monkeypatch)
    (here / "scene.toml").write_text(SCENE.replace("span = [0, 4]", "span = [0, 1]"))
    assert main(["tradeoff", "scene.toml", "--budget", "1", "--error", "1e-3", "--plot", "o.svg"]) == 0
    text = capsys.readouterr().out
    assert "recommended: simulate(scene" in text and "reference: " in text
    assert (here / "o.svg").exists()
    assert main(["tradeoff", "scene.toml", "--budget", "-1"]) == 2
    assert "budget must be a positive number" in capsys.readouterr().err


def test_draw_makes_a_figure_of_the_scene(here, capsys):
    assert main(["draw", "scene.toml"]) == 0
    assert (here / "scene.png").read_bytes().startswith(b"\x89PNG")
    assert capsys.readouterr().out == "figure: scene.png\n"
    assert main(["draw", "scene.toml", "--plot", "o.svg"]) == 0
    assert "<svg" in (here / "o.svg").read_text()
    (here / "scene.toml").write_text(SCENE.replace("normal = 1.0", 'normal = "much"'))
    assert main(["draw", "scene.toml"]) == 2
    assert "normal" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            SCENE.replace("stiffness", "stifness"),
            r"springs\[0\]: unknown field 'stifness'; a Spring has a",
        ),
        (SCENE.replace("inertia = 1.0", "inertia = -1.0"), "inertia must be positive, got -1"),
        (SCENE.replace('b = "ground"', 'b = "floor"'), "no body is called 'floor'"),
        (SCENE.replace("mu_static = 0.15", "mu_static = 0.05"), "swap or equalise them"),
        (SCENE.replace("[[springs]]", "[[strings]]"), "unknown table 'strings'; known are bodies"),
        (
            SCENE.replace("span = [0, 4]", "spam = 4"),
            "simulation: unknown entry 'spam'; known are span",
        ),
        (SCENE.replace("span = [0, 4]", ""), "no time span; give --span T0 T1"),
        (SCENE.replace("span = [0, 4]", "span = [4, 0]"), "t_span must run forward"),
        (SCENE.replace("span = [0, 4]", "span = 4\npoints = 3"), "span must be two times"),
        (SCENE.replace("span = [0, 4]", "span = [0, 4]\npoints = 1.5"), "points must be a whole number"),
        (SCENE.replace("span = [0, 4]", 'span = [0, 4]\nmethod = "LSODA"'), "unknown method 'LSODA'"),
        ("simulation = 3\n" + SCENE.replace("[simulation]\nspan = [0, 4]", ""), "simulation must be a table"),
        ("[[bodies]", "not valid TOML"),
        ("", "there is no free body"),
    ],
)
def test_bad_scene_files_exit_with_2_and_say_what_to_change(here, capsys, text, message):
    (here / "scene.toml").write_text(text)
    assert main(["run", "scene.toml"]) == 2
    captured = capsys.readouterr()
    assert re.search(message, captured.err)
    assert captured.out == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "none.toml"], "none.toml: cannot be read: No such file"),
        (["run", "scene.yaml"], "unknown kind of file '.yaml'; give a .toml or .json"),
        (["run", "list.json"], "expected a table with bodies"),
        (["run", "bad.json"], "not valid JSON"),
        (["run", "scene.toml", "--csv", "none/o.csv"], "there is no folder none; make it first"),
        (["run", "scene.toml", "--csv", "."], "--csv .: this is a folder; name a file"),
        (["run", "scene.toml", "--csv", 300 * "o"], "cannot be written: File name too long"),
        (["run", "scene.toml", "--plot", "o.what"], "no figure can be written as .what; choose from"),
        (["run", "scene.toml", "--formulation", "guess"], "unknown formulation 'guess'"),
        (["run", "scene.toml", "--points", "0"], "points must be a whole number from 2 on"),
        (["run"], "the following arguments are required: scene"),
        (["--bogus"], "unrecognized arguments"),
    ],
)
def test_bad_arguments_exit_with_2(here, capsys, arguments, message):
    (here / "list.json").write_text("[1]")
    (here / "bad.json").write_text("{")
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


def test_the_version_is_that_of_the_package(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"stickslip {__version__}\n"


@pytest.mark.parametrize("command", ["run", "explain", "draw", "tradeoff", "sweep"])
def test_each_command_says_how_it_is_used_and_what_its_exit_codes_mean(command, capsys):
    assert main([command, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"example: python -m stickslip {command} scene.toml" in text
    for words in ("0    all went well", "1    a simulation failed", "2    bad input", "130  interrupted"):
        assert words in text


def test_help_exits_with_0(capsys):
    assert main(["--help"]) == 0
    assert "stickslip-benchmark.png" in capsys.readouterr().out


def test_a_failed_simulation_exits_with_1_and_keeps_what_there_is(here, capsys, monkeypatch):
    def pull(t):
        return 1.0 if t < 0.6 else float("nan")

    from stickslip import signal

    broken = Scene(Body("block", inertia=1.0, velocity=1.0), Force("block", signal(pull, [0.5], period=0.2)))
    monkeypatch.setattr(Scene, "from_dict", classmethod(lambda cls, data: broken))
    assert main(["run", "scene.toml", "--csv", "o.csv", "--json", "o.json", "--plot", "o.png"]) == 1
    captured = capsys.readouterr()
    assert "at t = " in captured.err
    data = json.loads((here / "o.json").read_text())
    assert data["success"] is False and data["status"] == -1
    assert 0 < data["final"]["time"] <= 0.6
    with (here / "o.csv").open() as file:
        assert float(list(csv.DictReader(file))[-1]["time"]) == data["final"]["time"]
    assert (here / "o.png").exists()


@pytest.mark.slow
def test_names_are_printed_where_an_encoding_does_not_know_their_letters(here):
    text = (here / "scene.toml").read_text().replace("floor", "пол")
    (here / "names.toml").write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "stickslip", "run", "names.toml"]
    done = subprocess.run(
        command, capture_output=True, check=False, env={**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert rb"\u043f\u043e\u043b" in done.stdout


@pytest.mark.slow
def test_runs_as_a_module_into_a_closed_pipe(here):
    command = [sys.executable, "-m", "stickslip", "run", "scene.toml", "--csv", "o.csv"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    errors = process.stderr.read()
    process.stderr.close()
    assert process.wait() == 0
    assert errors == b""
    assert (here / "o.csv").exists()


def test_a_tradeoff_for_no_error_is_refused_before_it_is_measured(here, capsys):
    for option in ("--error", "--time"):
        assert main(["tradeoff", "scene.toml", option, "-1"]) == 2
        assert f"{option} -1: give a positive number" in capsys.readouterr().err


def test_an_interrupted_study_says_so(here, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("stickslip.__main__.tradeoff", interrupted)
    assert main(["tradeoff", "scene.toml"]) == 130
    assert capsys.readouterr().err == "stickslip: interrupted\n"


def test_files_nested_without_end_are_refused_and_byte_order_marks_are_not(here, capsys):
    (here / "deep.json").write_text("[" * 100_000)
    assert main(["explain", "deep.json"]) == 2
    assert "deep.json: not valid JSON" in capsys.readouterr().err
    (here / "marked.toml").write_text(SCENE, encoding="utf-8-sig")
    assert main(["explain", "marked.toml"]) == 0
