"""Results as files: CSV and JSON for reading elsewhere, npz for reading back without loss, pandas frames."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.modes import Mode
from stickslip.pieces import Piece
from stickslip.result import Event, Result
from stickslip.scene import Scene

__all__ = ["columns", "load", "save", "summary", "to_csv", "to_frame", "to_json"]

Array = NDArray[np.float64]
Target = str | PathLike[str]

_FORMAT = 2
_KEPT = tuple(field.name for field in fields(Piece) if field.name != "system")


def columns(result: Result) -> dict[str, NDArray[Any]]:
    """Return time, velocities, positions that are states, forces and modes, under their names in files.

    Parameters
    ----------
    result : Result

    Returns
    -------
    dict of str to array (n,)
        ``time``, ``velocity NAME``, ``position NAME``, ``force NAME``, ``breakaway NAME`` and ``mode NAME``.
        The breakaway level is that on the side of the force, as `Result.breakaway` gives it by default.
    """
    scene = result.scene
    bodies, drives = [b.name for b in scene.bodies], [d.name for d in scene.drives]
    placed = {name for spring in scene.springs if spring.stiffness for name in (spring.a, spring.b)}
    found: dict[str, NDArray[Any]] = {"time": result.t}
    found |= {f"velocity {name}": result.velocity(name) for name in (*bodies, *drives)}
    found |= {f"position {name}": result.position(name) for name in (*bodies, *drives) if name in placed}
    contacts = [contact.name for contact in scene.contacts]
    found |= {f"force {name}": result.force(name) for name in contacts}
    found |= {f"breakaway {name}": result.breakaway(name) for name in contacts}
    found |= {f"mode {name}": result.mode(name) for name in contacts}
    return found


def to_csv(result: Result, path: Target) -> None:
    """Write the columns of a result as CSV, a line per time; numbers keep all their digits.

    Parameters
    ----------
    result : Result
    path : path
        Times stand in s, everything else in the SI units of the scene.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    found = columns(result)
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(found)
        writer.writerows(zip(*(column.tolist() for column in found.values()), strict=True))


def summary(result: Result) -> dict[str, Any]:
    """Return outcome, events, counts and the state at the last time as plain data.

    Parameters
    ----------
    result : Result
    """
    data: dict[str, Any] = {
        "success": bool(result.success),
        "status": int(result.status),
        "message": result.message,
        "events": [_event_to_dict(event) for event in result.events],
        "stats": {name: _plain(value) for name, value in result.stats.items()},
    }
    if result.t.size:
        data["final"] = {name: _plain(column[-1]) for name, column in columns(result).items()}
    return data


def to_json(result: Result, path: Target) -> None:
    """Write outcome, events, counts and the state at the last time as JSON.

    Parameters
    ----------
    result : Result
    path : path

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    Path(path).write_text(json.dumps(summary(result), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def to_frame(result: Result) -> Any:
    """Return a pandas DataFrame with the columns of a result.

    Times are a column, not the index, because both limits of an event stand at the same time.

    Parameters
    ----------
    result : Result

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError as missing:
        raise ImportError("to_frame needs pandas: pip install 'stickslip[frames]'") from missing
    return pandas.DataFrame(columns(result))


# -- without loss -----------------------------------------------------------------------------------------


def save(result: Result, path: Target) -> None:
    """Write a result as npz, from which `load` brings back all of it.

    Beside what `load` needs, the file holds ``t``, ``y``, ``force``, ``breakaway`` and ``mode`` (a row per
    contact), so that it can be read without this package.

    Parameters
    ----------
    result : Result
        Signals and laws made of code are not written; `load` then asks for the scene.
    path : path
        Written as it stands, whatever its suffix.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    pieces, contacts = result._pieces, result.scene.contacts
    arrays: dict[str, Any] = {"t": result.t, "y": result.y, "piece_of": result._piece_of}
    for name in ("force", "breakaway", "mode"):
        rows = [getattr(result, name)(contact.name) for contact in contacts]
        arrays[name] = np.array(rows).reshape(len(contacts), result.t.size)
    for name in _KEPT:
        arrays |= _packed(f"piece.{name}", [getattr(piece, name) for piece in pieces])
    about = summary(result) | _assembly(result._system) | {"format": _FORMAT, "pieces": len(pieces)}
    arrays["about"] = np.array(json.dumps(about))
    with Path(path).open("wb") as file:
        np.savez_compressed(file, **arrays)


def load(path: Target, scene: Scene | None = None) -> Result:
    """Return the result that `save` wrote: the same numbers, and `result(t)` between them.

    Parameters
    ----------
    path : path
    scene : Scene, optional
        The simulated scene, where its signals or laws are code that no file holds.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not such a file, or the scene is missing or another one.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            data = {name: file[name] for name in file.files}
        about = json.loads(str(data["about"]))
        known = about["format"]
    except (KeyError, ValueError, EOFError) as error:
        raise ValueError(f"load: {path} was not written by stickslip's save ({error})") from None
    if known != _FORMAT:
        remedy = "update stickslip" if known > _FORMAT else "simulate and save again"
        raise ValueError(f"load: {path} has format {known}, this version reads {_FORMAT}; {remedy}")
    start, stop = about["span"]
    system = System(_scene_of(about, scene, path)).over(start, stop, about["stepped"])
    if (system.size, system.m) != (data["y"].shape[0], data["force"].shape[0]):
        raise ValueError(f"load: {path} holds the motion of another scene than the one given")
    return _rebuilt(system, data, about)


def _rebuilt(system: System, data: Mapping[str, Any], about: Mapping[str, Any]) -> Result:
    count = about["pieces"]
    # files of version 0.1.0 know no parabolas
    present = [name for name in _KEPT if f"piece.{name}.present" in data]
    kept = {name: _unpacked(f"piece.{name}", data, count) for name in present}
    pieces = [Piece(system=system, **{name: kept[name][k] for name in present}) for k in range(count)]
    return Result(
        scene=system.scene,
        t=data["t"],
        y=data["y"],
        events=[_event_from_dict(row) for row in about["events"]],
        success=about["success"],
        status=about["status"],
        message=about["message"],
        stats=about["stats"],
        _system=system,
        _pieces=pieces,
        _piece_of=data["piece_of"].astype(np.intp),
    )


def _packed(name: str, values: list[Any]) -> dict[str, NDArray[Any]]:
    """Return arrays that hold a list of numbers, arrays, or tuples of arrays, some of which may be None."""
    present = np.array([value is not None for value in values], dtype=bool)
    there = [value for value in values if value is not None]
    if there and isinstance(there[0], tuple):
        found = {f"{name}.present": present, f"{name}.width": np.array(len(there[0]))}
        for place in range(len(there[0])):
            found |= _packed(f"{name}.{place}", [value[place] for value in there])
        return found
    rows = [np.asarray(value) for value in there]
    flat = np.concatenate([row.ravel() for row in rows]) if rows else np.empty(0)
    shapes = np.array([row.shape for row in rows], dtype=np.intp)
    return {f"{name}.present": present, f"{name}.shapes": shapes, f"{name}.values": flat}


def _unpacked(name: str, data: Mapping[str, Any], count: int) -> list[Any]:
    present = data[f"{name}.present"]
    there = int(present.sum())
    rows: list[Any]
    if f"{name}.width" in data:
        parts = [_unpacked(f"{name}.{place}", data, there) for place in range(int(data[f"{name}.width"]))]
        rows = list(zip(*parts, strict=True))
    else:
        shapes = data[f"{name}.shapes"]
        ends = np.cumsum([math.prod(shape) for shape in shapes.tolist()], dtype=np.intp)
        flat = np.split(data[f"{name}.values"], ends[:-1])
        rows = [part.reshape(shape) for part, shape in zip(flat, shapes, strict=False)]
        rows = [row if row.ndim else row.item() for row in rows]
    found = iter(rows)
    return [next(found) if here else None for here in present[:count].tolist()]


def _assembly(system: System) -> dict[str, Any]:
    """Return what assembles the system again."""
    return {"span": system.span, "stepped": system.stepped, "scene": _scene_to_dict(system.scene)}


def _scene_to_dict(scene: Scene) -> dict[str, Any] | None:
    try:
        return scene.to_dict()
    except ValueError:
        return None


def _scene_of(about: Mapping[str, Any], scene: Scene | None, path: Target) -> Scene:
    if scene is not None:
        return scene
    if about["scene"] is None:
        raise ValueError(f"load: the scene of {path} holds code that no file can; give load(path, scene=...)")
    return Scene.from_dict(about["scene"])


def _event_to_dict(event: Event) -> dict[str, Any]:
    return asdict(event) | {"before": event.before.name, "after": event.after.name}


def _event_from_dict(row: Mapping[str, Any]) -> Event:
    return Event(row["t"], row["contact"], Mode[row["before"]], Mode[row["after"]], row["cause"])


def _plain(value: Any) -> Any:
    """Return a value as JSON knows it; what is not finite becomes text."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [_plain(item) for item in value]
    return value
