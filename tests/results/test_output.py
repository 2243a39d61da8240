"""Results as files: nothing is lost on the way, and what is missing is said."""

import builtins
import csv
import json

import numpy as np
import pytest
from references import NAMES, load

import stickslip
from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    LuGre,
    PreSlip,
    Scene,
    output,
    signal,
    simulate,
    sine,
)
from stickslip.benchmark import flywheel_benchmark


@pytest.fixture(scope="module")
def blocks():
    return simulate(load("two-blocks").scene, (0.0, 15.0))


@pytest.fixture(scope="module")
def wheels():
    return simulate(flywheel_benchmark(), (0.0, 4.0))


def same(first, second, times):
    assert np.array_equal(first.t, second.t)
    assert np.array_equal(first.y, second.y)
    assert first.events == second.events
    assert (first.success, first.status, first.message) == (second.success, second.status, second.message)
    assert first.stats == second.stats
    assert first.scene == second.scene
    assert np.array_equal(first(times), second(times))
    for contact in first.scene.contacts:
        for name in ("force", "breakaway", "mode", "power", "normal"):
            assert np.array_equal(getattr(first, name)(contact.name), getattr(second, name)(contact.name))


@pytest.mark.parametrize("name", NAMES)
def test_a_saved_reference_comes_back_to_the_bit(name, tmp_path):
    scene = load(name).scene
    result = simulate(scene, (0.0, 2.0))
    output.save(result, tmp_path / "result.npz")
    same(result, stickslip.load(tmp_path / "result.npz"), np.linspace(0.0, 2.0, 101))


@pytest.mark.parametrize(
    "options",
    [
        {"formulation": "merged"},
        {"formulation": "multiplier"},
        {"method": "RK4", "step": 0.002},
        {"t_eval": np.linspace(0.0, 1.0, 11)},
    ],
    ids=str,
)
def test_every_way_to_simulate_comes_back(options, tmp_path):
    result = simulate(flywheel_benchmark(), (0.0, 1.0), **options)
    output.save(result, tmp_path / "result.npz")
    same(result, stickslip.load(tmp_path / "result.npz"), np.linspace(0.0, 1.0, 101))


@pytest.mark.parametrize(
    "law",
    [PreSlip(DryFriction(0.2, 0.1)), LuGre(DryFriction(0.2, 0.1), stiffness=1e4, damping=10.0)],
    ids=repr,
)
def test_other_laws_and_curved_loads_come_back(law, tmp_path):
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.5),
        Contact("c", "a", GROUND, law, normal=sine(5.0, 2.0, offset=8.0)),
        Force("a", sine(2.0, 1.0)),
    )
    result = simulate(scene, (0.0, 0.5))
    output.save(result, tmp_path / "result.npz")
    same(result, stickslip.load(tmp_path / "result.npz"), np.linspace(0.0, 0.5, 11))


def test_a_sparse_result_without_dense_output_comes_back(tmp_path):
    result = simulate(flywheel_benchmark(), (0.0, 4.0), t_eval=[0.0, 0.48, 3.0], dense_output=False)
    output.save(result, tmp_path / "result.npz")
    back = stickslip.load(tmp_path / "result.npz")
    assert np.array_equal(back.y, result.y)
    assert np.array_equal(back.force("brake"), result.force("brake"))
    with pytest.raises(ValueError, match="dense_output=True"):
        back(1.0)


def test_an_archive_is_read_without_this_package(wheels, tmp_path):
    output.save(wheels, tmp_path / "a.file")
    with np.load(tmp_path / "a.file", allow_pickle=False) as data:
        assert np.array_equal(data["force"][1], wheels.force("brake"))
        assert np.array_equal(data["mode"][0], wheels.mode("interface"))
        assert np.array_equal(data["breakaway"][0], wheels.breakaway("interface"))
        about = json.loads(str(data["about"]))
    assert [event["contact"] for event in about["events"]] == [e.contact for e in wheels.events]


def test_code_is_asked_for(tmp_path):
    scene = Scene(Body("a", inertia=1.0), Force("a", signal(lambda t: t * t, period=1.0)))
    result = simulate(scene, (0.0, 1.0))
    output.save(result, tmp_path / "r.npz")
    with pytest.raises(ValueError, match=r"holds code that no file can; give load\(path, scene=...\)"):
        stickslip.load(tmp_path / "r.npz")
    same(result, stickslip.load(tmp_path / "r.npz", scene), np.linspace(0.0, 1.0, 11))
    with pytest.raises(ValueError, match="the motion of another scene"):
        stickslip.load(tmp_path / "r.npz", flywheel_benchmark())


def test_other_files_are_refused(tmp_path):
    np.savez(tmp_path / "other.npz", x=np.arange(3))
    with pytest.raises(ValueError, match="not written by stickslip's save"):
        stickslip.load(tmp_path / "other.npz")
    (tmp_path / "text").write_text("no archive")
    with pytest.raises(ValueError, match="not written by stickslip's save"):
        stickslip.load(tmp_path / "text")
    with pytest.raises(FileNotFoundError):
        stickslip.load(tmp_path / "none.npz")


def test_csv_has_every_digit(blocks, tmp_path):
    output.to_csv(blocks, tmp_path / "r.csv")
    with (tmp_path / "r.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        "time",
        *(f"velocity {name}" for name in ("b0", "b1", "plate")),
        *(f"position {name}" for name in ("b0", "b1", "plate")),
        *(f"{what} {name}" for what in ("force", "breakaway", "mode") for name in ("f0", "f1")),
    ]
    assert np.array_equal([float(row["time"]) for row in rows], blocks.t)
    assert np.array_equal([float(row["velocity b1"]) for row in rows], blocks.velocity("b1"))
    assert np.array_equal([int(row["mode f0"]) for row in rows], blocks.mode("f0"))


def test_csv_has_no_positions_where_no_spring_acts(wheels):
    assert not any(name.startswith("position") for name in output.columns(wheels))


def test_json_holds_events_work_and_final_state(wheels, tmp_path):
    output.to_json(wheels, tmp_path / "r.json")
    data = json.loads((tmp_path / "r.json").read_text())
    assert data["success"] is True and data["status"] == 0
    assert data["stats"]["events"] == len(data["events"]) == 5
    first = data["events"][0]
    assert (first["t"], first["contact"]) == (wheels.events[0].t, "interface")
    assert (first["before"], first["after"]) == ("BACKWARD", "STUCK")
    assert data["final"]["time"] == 4.0
    assert data["final"]["velocity wheel1"] == wheels.velocity("wheel1")[-1]


def test_frame_has_the_same_columns(wheels):
    pytest.importorskip("pandas")
    frame = output.to_frame(wheels)
    assert list(frame.columns) == list(output.columns(wheels))
    assert frame["force brake"].to_numpy().tolist() == wheels.force("brake").tolist()


def test_frame_names_the_extra(wheels, monkeypatch):
    real = builtins.__import__

    def without_pandas(name, *rest, **options):
        if name == "pandas":
            raise ImportError(name)
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without_pandas)
    with pytest.raises(ImportError, match=r"stickslip\[frames\]"):
        output.to_frame(wheels)
