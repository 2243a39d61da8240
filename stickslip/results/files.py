"""Results as npz files, which are read back without loss."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any
from zipfile import BadZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.loads.loads import Span
from stickslip.equations.path import Path as MotionPath
from stickslip.equations.system import System
from stickslip.model.checks import file_path, in_order
from stickslip.model.modes import Mode
from stickslip.model.quantities import position
from stickslip.model.scene import Scene
from stickslip.results.outcome import Event, Outcome, Target
from stickslip.results.patchwork import Patchwork
from stickslip.results.pieces import Piece, Pieces
from stickslip.results.readable import Readable, check_result
from stickslip.results.samples import Samples
from stickslip.results.tables import how_it_ended
from stickslip.results.trajectory import Trajectory

_FORMAT = 7
_OF_PIECE = tuple(field.name for field in fields(Piece) if field.name != "path")
_OF_PATH = tuple(field.name for field in fields(MotionPath))


def save(result: Readable, path: Target) -> None:
    """Write a result as npz, from which `stickslip.load` brings back all of it.

    Beside what `stickslip.load` needs, the file holds ``t``, ``y``, ``force``, ``breakaway`` and ``mode`` (a row per
    contact), so that it can be read without this package. For runs in a row it holds these of each run, as ``run.0.t``
    and so on.

    Parameters
    ----------
    result : Result or Joined
        Signals and laws made of code are not written; `stickslip.load` then asks for the scene.
    path : path
        Written as it stands, whatever its suffix.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    check_result(result, "save")
    target, each = file_path(path, "save"), [_arrays(run) for run in result.runs]
    arrays = each[0]
    if not hasattr(result, "samples"):  # runs in a row
        arrays = {f"run.{k}.{name}": array for k, run in enumerate(each) for name, array in run.items()}
        arrays["runs"] = np.array(len(each))
    with target.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _arrays(result: Outcome) -> dict[str, Any]:
    """Return all of one run as arrays by name."""
    samples = result.samples
    system, parts = samples.system, samples.trajectory.parts
    pieces = samples.trajectory.whole.pieces
    arrays: dict[str, Any] = {name: getattr(samples, name) for name in ("t", "piece_of", "taus", "y")}
    for name in ("force", "breakaway", "mode"):
        rows = [getattr(samples, name)(row.name) for row in system.rows]
        arrays[name] = np.array(rows).reshape(system.m, samples.t.size)
    for name in _OF_PIECE:
        arrays |= _packed(f"piece.{name}", [getattr(piece, name) for piece in pieces])
    paths = [piece.path for piece in pieces]
    for name in _OF_PATH:
        arrays |= _packed(f"path.{name}", [None if path is None else getattr(path, name) for path in paths])
    for k, part in enumerate(parts):
        if isinstance(part, Patchwork):
            arrays |= {f"patchwork.{k}.{name}": array for name, array in part.to_arrays().items()}
    start, stop, stepped = samples.trajectory.span
    about = how_it_ended(result) | {
        "format": _FORMAT,
        "pieces": len(pieces),
        "patchworks": [k for k, part in enumerate(parts) if isinstance(part, Patchwork)],
        "span": [start, stop],
        "stepped": stepped,
    }
    moving = [*system.names, *(drive.name for drive in system.scene.drives)]
    about["positions"] = [moving[i] for i in system.placed] if system.observed else []
    about["names"] = _names(system)
    about["scene"] = _scene_to_dict(system.scene)
    arrays["about"] = np.array(json.dumps(about))
    return arrays


def read(path: Target, scene: Scene | Sequence[Scene] | None = None) -> Outcome | list[Outcome]:
    """Return the run that `save` wrote, or a list of runs in a row.

    Where signals or laws of the scene are code, which no file holds, `scene` has to be given: for runs in a row one
    for each.
    """
    try:
        with file_path(path, "load").open("rb") as opened:
            if not is_zipfile(opened):
                raise ValueError("no archive")
            opened.seek(0)
            with np.load(opened, allow_pickle=False) as file:
                data = {name: file[name] for name in file.files}
        in_a_row = "runs" in data
        runs = [_with_prefix(f"run.{k}.", data) for k in range(int(data["runs"]))] if in_a_row else [data]
        abouts = [json.loads(str(run["about"])) for run in runs]
        formats = {about["format"] for about in abouts}
    except (AttributeError, KeyError, ValueError, EOFError, BadZipFile, zlib.error):
        raise ValueError(f"load: {path} was not written by stickslip's save, or only in part") from None
    for known in formats - {_FORMAT}:
        raise ValueError(
            f"load: {path} has format {known}, this version reads {_FORMAT}; update stickslip or simulate again"
        )
    if not in_a_row:
        return _kept(data, abouts[0], scene, path)
    scenes: Sequence[Any] = [None] * len(runs) if scene is None else in_order(scene, "load: scene", "Scene(...)")
    if len(scenes) != len(runs):
        raise ValueError(f"load: {path} holds {len(runs)} runs in a row; give the scene of each, got {len(scenes)}")
    return [_kept(run, about, one, path) for run, about, one in zip(runs, abouts, scenes, strict=True)]


def _with_prefix(prefix: str, data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arrays whose names begin with `prefix`, under the rest of their names."""
    return {name.removeprefix(prefix): data[name] for name in data if name.startswith(prefix)}


def _kept(data: Mapping[str, Any], about: Mapping[str, Any], scene: Any, path: Target) -> Outcome:
    """Return the run that the arrays hold."""
    start, stop = about["span"]
    simulated = _scene_of(about, scene, path)
    known = {name for name in about.get("positions", ()) if name in System(simulated).index}
    system = System(simulated, [(name, position(name)) for name in sorted(known)])
    sizes, names = (system.size, system.m), _names(system)
    if sizes != (data["y"].shape[0], data["force"].shape[0]) or about.get("names", names) != names:
        raise ValueError(f"load: {path} holds the motion of another scene than the one given")
    parts: list[Piece | Patchwork] = list(_pieces(data, about["pieces"]))
    for k in about.get("patchworks", []):
        parts.insert(k, Patchwork.from_arrays(system, _with_prefix(f"patchwork.{k}.", data)))
    trajectory = Trajectory(system, Span(start, stop, about["stepped"]), Pieces(tuple(parts)))
    samples = Samples(trajectory, data["t"], data["piece_of"].astype(np.intp), data["taus"], data["y"])
    events = [Event(**row | {key: Mode[row[key]] for key in ("before", "after")}) for row in about["events"]]
    ended = about["success"], about["status"], about["message"], about["stats"]
    return Outcome(simulated, events, *ended, trajectory, samples)


def _pieces(data: Mapping[str, Any], count: int) -> tuple[Piece, ...]:
    own = {name: _unpacked(f"piece.{name}", data, count) for name in _OF_PIECE}
    of_path = {name: _unpacked(f"path.{name}", data, count) for name in _OF_PATH}
    found = []
    for k in range(count):
        values: dict[str, Any] = {name: of_path[name][k] for name in _OF_PATH}
        path = None if values["taus"] is None else MotionPath(**values)
        found.append(Piece(path=path, **{name: own[name][k] for name in _OF_PIECE}))
    return tuple(found)


def _packed(name: str, values: list[Any]) -> dict[str, NDArray[Any]]:
    """Return arrays that hold a list of numbers or arrays, some of which may be None."""
    present = np.array([value is not None for value in values], dtype=bool)
    rows = [np.asarray(value) for value in values if value is not None]
    flat = np.concatenate([row.ravel() for row in rows]) if rows else np.empty(0)
    shapes = np.array([row.shape for row in rows], dtype=np.intp)
    return {f"{name}.present": present, f"{name}.shapes": shapes, f"{name}.values": flat}


def _unpacked(name: str, data: Mapping[str, Any], count: int) -> list[Any]:
    present = data[f"{name}.present"]
    shapes = data[f"{name}.shapes"]
    ends = np.cumsum([math.prod(shape) for shape in shapes.tolist()], dtype=np.intp)
    flat = np.split(data[f"{name}.values"], ends[:-1])
    rows: list[Any] = [part.reshape(shape) for part, shape in zip(flat, shapes, strict=False)]
    rows = [row if row.ndim else row.item() for row in rows]
    found = iter(rows)
    return [next(found) if here else None for here in present[:count].tolist()]


def _names(system: System) -> list[str]:
    """Return the names of all that moves, in the order of the states and rows."""
    drives = [drive.name for drive in system.scene.drives]
    return [*system.names, *drives, *(row.name for row in system.rows), *system.blocks]


def _scene_to_dict(scene: Scene) -> dict[str, Any] | None:
    try:
        return scene.to_dict()
    except ValueError:
        return None


def _scene_of(about: Mapping[str, Any], scene: Any, path: Target) -> Scene:
    if scene is not None:
        if not isinstance(scene, Scene):
            raise TypeError(f"load: scene must be a Scene, got {type(scene).__name__}")
        # scenes with code cannot be compared here: `_kept` compares their names
        given = _scene_to_dict(scene)
        if given is not None and about["scene"] not in (None, json.loads(json.dumps(given))):
            raise ValueError(
                f"load: {path} holds the motion of another scene than the one given; leave scene out to get that"
            )
        return scene
    if about["scene"] is None:
        raise ValueError(f"load: the scene of {path} holds code that no file can; give load(path, scene=...)")
    return Scene.from_dict(about["scene"])
