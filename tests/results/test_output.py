"""Results as files: nothing is lost on the way, and what is missing is said."""

import builtins
import csv
import json

import numpy as np
import pytest

import stickslip
from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    LuGre,
    PreSlip,
    Sampled,
    Scene,
    Spring,
    StateSpace,
    Stop,
    join,
    output,
    piecewise_linear,
    signal,
    simulate,
    sine,
    velocity,
)
from stickslip.benchmark import flywheel_benchmark
from stickslip.results.patchwork import Patchwork
from stickslip.results.pieces import Piece
from stickslip.simulation import simulate as module
from validation.exact import REFERENCES, reference


@pytest.fixture(scope="module")
def blocks():
    return simulate(reference("two-blocks").scene, (0.0, 15.0))


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


@pytest.mark.parametrize("name", REFERENCES)
def test_a_saved_reference_comes_back_to_the_bit(name, tmp_path):
    scene = reference(name).scene
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


@pytest.mark.parametrize("smooth", [False, True])
def test_what_was_followed_part_by_part_comes_back(smooth, tmp_path, monkeypatch):
    """A body that leaves rest with the square of time is followed as a whole, until its load has a break."""
    monkeypatch.setattr(module, "_MANY", 1)
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=v) for name, v in (("a", 0.0), ("b", 2.0), ("c", -1.0))),
        *(Contact(f"of {name}", name, GROUND, DryFriction(0.2, 0.1), normal=10.0) for name in "bc"),
        Contact("of a", "a", GROUND, DryFriction(0.2, 0.2 if smooth else 0.1), normal=10.0),
        Spring("b", "c", stiffness=2.0),
        Force("a", piecewise_linear([0.0, 1.0, 3.0], [2.0 if smooth else 1.9, 2.1 if smooth else 1.5, 2.5])),
    )
    result = simulate(scene, (0.0, 3.0))
    kinds = {type(part) for part in result.trajectory.parts}
    assert kinds == ({Piece, Patchwork} if smooth else {Patchwork})
    output.save(result, tmp_path / "result.npz")
    same(result, stickslip.load(tmp_path / "result.npz"), np.linspace(0.0, 3.0, 101))


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


def test_another_scene_is_refused_where_the_file_holds_the_simulated_one(tmp_path):
    scene = Scene(Body("m", inertia=1.0, velocity=0.3), Force("m", sine(1.0, 2.0)))
    output.save(simulate(scene, (0.0, 1.0)), tmp_path / "r.npz")
    assert stickslip.load(tmp_path / "r.npz", scene).scene == scene
    with pytest.raises(ValueError, match=r"the motion of another scene.*leave scene out"):
        stickslip.load(tmp_path / "r.npz", scene.replace("m", inertia=3.0))


def test_a_scene_of_the_same_size_with_other_names_is_not_taken_for_the_one_simulated(tmp_path):
    def made(*names):
        bodies = [Body(name, inertia=k + 1.0, velocity=k + 1.0) for k, name in enumerate(names)]
        return Scene(*bodies, Force("a", signal(lambda t: t * t, period=1.0)))

    output.save(simulate(made("a", "b"), (0.0, 1.0)), tmp_path / "r.npz")
    assert stickslip.load(tmp_path / "r.npz", made("a", "b")).velocity("b")[-1] == 2.0
    for others in (("a", "c"), ("b", "a")):
        with pytest.raises(ValueError, match="the motion of another scene"):
            stickslip.load(tmp_path / "r.npz", made(*others))


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
        *(f"{what} {name}" for what in ("normal", "power", "heat") for name in ("f0", "f1")),
        *("heat of dampers", "kinetic energy", "spring energy", "work of loads", "work of drives"),
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


def test_columns_hold_powers_and_the_ledger(blocks):
    found, ledger = output.columns(blocks), blocks.energy()
    assert np.array_equal(found["normal f1"], blocks.normal("f1"))
    assert np.array_equal(found["power f0"], blocks.power("f0"))
    assert np.array_equal(found["heat f0"], ledger.contacts["f0"])
    assert np.array_equal(found["spring energy"], ledger.spring)
    assert np.array_equal(found["work of drives"], ledger.drives)
    balance = found["kinetic energy"] + found["spring energy"] + found["heat of dampers"]
    balance = balance + found["heat f0"] + found["heat f1"]
    assert balance - balance[0] == pytest.approx(found["work of drives"], abs=1e-9 * balance.max())


def test_columns_balance_with_impacts_and_changes_between_runs_too():
    """A ram on a pile: 500 kg and 300 kg go on with m1 v / (m1 + m2). The next run begins with 150 J more."""
    ram, pile = Body("ram", inertia=500.0, position=2.0), Body("pile", inertia=300.0)
    soil = Contact("soil", "pile", GROUND, DryFriction(1.0, 1.0), normal=6e4)
    filtered = StateSpace("filtered", [[-10.0]], [[10.0]], [[1.0]], inputs=[velocity("ram")])
    two = Sampled("two", period=0.3, inputs=[velocity("pile")], output=lambda t, x, u: (u[0], t), outputs=2)
    anvil = Stop("anvil", "ram", "pile", lower=0.0)
    one = simulate(Scene(ram, pile, soil, anvil, Force("ram", -5000.0), filtered, two), (0.0, 1.0))
    found = output.columns(one)
    assert found["lost in impacts"][-1] == pytest.approx(5000 * 2 * 300 / 800)
    assert np.array_equal(found["output filtered"], one.output("filtered"))
    assert np.array_equal(found["output two[1]"], one.output("two")[1]) and "output two" not in found
    later = simulate(Scene(Body("pile", inertia=300.0, velocity=1.0, position=-0.1), soil), (1.0, 2.0))
    both = join([one, later])
    found = output.columns(both)
    heats = ("kinetic energy", "heat soil", "lost in impacts")
    gains = sum(found[name] for name in heats) - found["work of loads"] - found["changes between runs"]
    assert np.abs(gains).max() < 1e-9 * 5000 and found["changes between runs"][-1] == pytest.approx(150.0)
    assert np.array_equal(found["position pile"], both.position("pile"))  # a state of the first run only
    assert np.isnan(found["output filtered"][-1])


def test_energy_is_left_out_where_the_motion_was_not_kept():
    sparse = simulate(flywheel_benchmark(), (0.0, 4.0), t_eval=[0.0, 0.48, 3.0], dense_output=False)
    found = output.columns(sparse)
    assert "power brake" in found and not any("heat" in name or "energy" in name for name in found)


@pytest.mark.parametrize(
    ("motion", "velocity", "force"),
    [("rotation", "rad/s", "N m"), ("translation", "m/s", "N"), (None, "m/s | rad/s", "N | N m")],
)
def test_units_stand_in_frames_json_and_heads(motion, velocity, force, tmp_path):
    pytest.importorskip("pandas")
    scene = Scene(*flywheel_benchmark().elements, motion=motion)
    result = simulate(scene, (0.0, 1.0))
    units = result.to_frame().attrs["units"]
    assert list(units) == list(output.columns(result))
    assert (units["velocity wheel1"], units["force brake"], units["mode brake"]) == (velocity, force, "")
    assert (units["time"], units["normal brake"], units["power brake"], units["heat brake"]) == tuple("sNWJ")
    result.to_csv(tmp_path / "r.csv")
    heads = (tmp_path / "r.csv").read_text().partition("\n")[0].split(",")
    # where the unit is not known heads have none, so that columns are found by their names
    assert (f"velocity wheel1 [{velocity}]" in heads) == (motion is not None)
    assert "mode brake" in heads
    result.to_csv(tmp_path / "r.csv", units=motion is None)
    heads = (tmp_path / "r.csv").read_text().partition("\n")[0].split(",")
    assert (f"force brake [{force}]" in heads) == (motion is None)
    output.to_json(result, tmp_path / "r.json")
    assert json.loads((tmp_path / "r.json").read_text())["units"]["velocity wheel1"] == velocity


def test_a_radius_turns_units_of_rotation_into_those_of_translation():
    rub = Contact("rub", "wheel", GROUND, DryFriction(0.2, 0.1), normal=1.0, radius_a=0.3)
    scene = Scene(Body("wheel", inertia=1.0, velocity=1.0), rub, motion="rotation")
    result = simulate(scene, (0.0, 1.0))
    assert output.column_units(result)["force rub"] == "N"
    assert output.column_units(result)["velocity wheel"] == "rad/s"
    assert (
        "(forces in N m, velocities in rad/s)"
        in simulate(
            Scene(
                Body("a", inertia=1.0, velocity=0.1),
                Contact("c", "a", GROUND, rub.law, normal=1.0),
                motion="rotation",
            ),
            (0.0, 2.0),
        ).explain()
    )


def test_frame_names_the_extra(wheels, monkeypatch):
    real = builtins.__import__

    def without_pandas(name, *rest, **options):
        if name == "pandas":
            raise ImportError(name)
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without_pandas)
    with pytest.raises(ImportError, match=r"stickslip\[frames\]"):
        output.to_frame(wheels)


@pytest.mark.parametrize("damage", ["half of it", "a wrong byte", "an array", "text", "nothing"])
def test_a_damaged_file_is_refused(tmp_path, wheels, damage):
    path, other = tmp_path / "r.npz", tmp_path / "r.npy"
    wheels.save(path)
    np.save(other, np.zeros(3))
    data = path.read_bytes()
    wrong = bytearray(data)
    # within an array: bytes of the archive's own that say nothing, such as dates, are not looked at
    wrong[data.index(b"y.npy") + 200] ^= 255
    kinds = {
        "half of it": data[: len(data) // 2],
        "a wrong byte": bytes(wrong),
        "an array": other.read_bytes(),
    }
    path.write_bytes({**kinds, "text": b"abc", "nothing": b""}[damage])
    with pytest.raises(ValueError, match="was not written by stickslip's save, or only in part"):
        stickslip.load(path)


def test_no_column_takes_the_place_of_another(tmp_path):
    """Two outputs of a block "s" beside a block "s[0]"; a contact "of dampers"."""
    two = StateSpace("s", [[0.0]], [[1.0]], [[1.0], [2.0]], inputs=[stickslip.TIME])
    one = StateSpace("s[0]", [[0.0]], [[1.0]], [[1.0]], inputs=[stickslip.TIME])
    result = simulate(Scene(Body("a", inertia=1.0), two, one), (0.0, 1.0))
    with pytest.raises(ValueError, match=r"two columns are called 'output s\[0\]'; give one"):
        result.to_csv(tmp_path / "r.csv")
    contact = Contact("of dampers", "a", GROUND, DryFriction(0.3, 0.2), normal=1.0)
    result = simulate(Scene(Body("a", inertia=1.0, velocity=1.0), contact), (0.0, 1.0))
    with pytest.raises(ValueError, match="two columns are called 'heat of dampers'"):
        output.columns(result)
