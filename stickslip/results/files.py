"""Results as files: CSV and JSON for reading elsewhere, npz for reading back without loss, pandas frames."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.path import Path as Steps
from stickslip.equations.system import System
from stickslip.model.modes import Mode
from stickslip.model.quantities import Quantity, position
from stickslip.model.quantities import output as output_of
from stickslip.model.scene import Scene
from stickslip.results.energy import energy
from stickslip.results.outcome import Event, Outcome
from stickslip.results.patchwork import Patchwork
from stickslip.results.samples import Samples
from stickslip.results.trajectory import Piece, Pieces, Trajectory
from stickslip.results.units import units as units_of

__all__ = [
    "Kept",
    "column_units",
    "columns",
    "output",
    "read",
    "save",
    "summary",
    "to_csv",
    "to_frame",
    "to_json",
]

Array = NDArray[np.float64]
Target = str | PathLike[str]

_FORMAT = 3
_READS = (2, 3)
_OF_PIECE = tuple(field.name for field in fields(Piece) if field.name != "path")
_OF_PATH = tuple(field.name for field in fields(Steps))


def columns(result: Outcome) -> dict[str, NDArray[Any]]:
    """Return motion, forces, modes, powers and energies of a result, under their names in files.

    Parameters
    ----------
    result : Outcome

    Returns
    -------
    dict of str to array (n,)
        ``time``; ``velocity NAME`` of bodies and drives, and ``position NAME`` where it is a state; ``force NAME`` and
        ``mode NAME`` of contacts, ties and clutches; ``breakaway NAME``, ``normal NAME``, ``power NAME`` and, counted
        from the start, ``heat NAME`` of contacts; ``heat of dampers``, ``kinetic energy``, ``spring energy``, ``work
        of loads`` and ``work of drives``. Heat, energy and work are left out where only the outputs were kept.
    """
    found = _state_columns(result)
    samples = result.samples
    frictional = _frictional(samples.system)
    found |= {f"normal {name}": samples.normal(name) for name in frictional}
    found |= {f"power {name}": samples.force(name) * samples.relative_velocity(name) for name in frictional}
    if not samples.t.size or samples.trajectory.is_dense:
        ledger = energy(result)
        found |= {f"heat {name}": heat for name, heat in ledger.contacts.items()}
        found["heat of dampers"] = sum(ledger.dampers.values(), np.zeros_like(samples.t))
        found |= {"kinetic energy": ledger.kinetic, "spring energy": ledger.spring}
        found |= {"work of loads": ledger.loads, "work of drives": ledger.drives}
    return found


def column_units(result: Outcome) -> dict[str, str]:
    """Return the unit of each column; modes have none.

    The scene or its bodies say whether they rotate or move along lines; where neither does, both units are named.

    Parameters
    ----------
    result : Outcome
    """
    scene = result.samples.system.scene
    found = {"time": "s"}
    for one in (*scene.bodies, *scene.drives):
        unit = units_of(scene, one)
        found |= {f"velocity {one.name}": unit.velocity, f"position {one.name}": unit.position}
    for row in scene.rows:
        force = units_of(scene, row).force
        found |= {f"force {row.name}": force, f"breakaway {row.name}": force, f"mode {row.name}": ""}
        found |= {f"normal {row.name}": "N", f"power {row.name}": "W", f"heat {row.name}": "J"}
    energies = ("heat of dampers", "kinetic energy", "spring energy", "work of loads", "work of drives")
    return found | dict.fromkeys(energies, "J")


def _frictional(system: System) -> list[str]:
    """Return the names of the rows that are contacts."""
    return [row.name for row, has in zip(system.rows, system.is_friction.tolist(), strict=True) if has]


def _state_columns(result: Outcome) -> dict[str, NDArray[Any]]:
    samples = result.samples
    system = samples.system
    moving = [*system.names, *(drive.name for drive in system.scene.drives)]
    found: dict[str, NDArray[Any]] = {"time": samples.t}
    found |= {f"velocity {name}": samples.velocity(name) for name in moving}
    found |= {f"position {moving[i]}": samples.position(moving[i]) for i in system.position_state}
    names = [row.name for row in system.rows]
    found |= {f"force {name}": samples.force(name) for name in names}
    found |= {f"breakaway {name}": samples.breakaway(name) for name in _frictional(system)}
    found |= {f"mode {name}": samples.mode(name) for name in names}
    return found


def to_csv(result: Outcome, path: Target, *, units: bool | None = None) -> None:
    """Write the columns of a result as CSV, a line per time; numbers keep all their digits.

    Parameters
    ----------
    result : Outcome
    path : path
        Times stand in s, everything else in the SI units of the scene.
    units : bool, optional
        Whether the heads of the columns say the units, as in ``velocity wheel [rad/s]``. By default they do where all
        bodies, or the scene, say whether they rotate.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    with_units = None not in result.samples.system.scene.motions.values() if units is None else units
    write_columns(columns(result), path, column_units(result) if with_units else {})


def write_columns(found: dict[str, NDArray[Any]], path: Target, known: dict[str, str]) -> None:
    """Write columns as CSV, with the units that are known in their heads.

    Parameters
    ----------
    found : dict of str to array (n,)
    path : path
    known : dict of str to str
        Units by column.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    heads = [f"{name} [{known[name]}]" if known.get(name) else name for name in found]
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(heads)
        writer.writerows(zip(*(column.tolist() for column in found.values()), strict=True))


def summary(result: Outcome) -> dict[str, Any]:
    """Return outcome, events, counts and the columns at the last time as plain data.

    Parameters
    ----------
    result : Outcome
    """
    data = _how_it_ended(result)
    if result.samples.t.size:
        data["final"] = {name: _plain(column[-1]) for name, column in columns(result).items()}
        known = column_units(result)
        data["units"] = {name: known[name] for name in data["final"]}
    return data


def _how_it_ended(result: Outcome) -> dict[str, Any]:
    """Return outcome, events and counts as plain data."""
    return {
        "success": bool(result.success),
        "status": int(result.status),
        "message": result.message,
        "events": [_event_to_dict(event) for event in result.events],
        "stats": {name: _plain(value) for name, value in result.stats.items()},
    }


def to_json(result: Outcome, path: Target) -> None:
    """Write outcome, events, counts and the state at the last time as JSON.

    Parameters
    ----------
    result : Outcome
    path : path

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    Path(path).write_text(json.dumps(summary(result), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def to_frame(result: Outcome) -> Any:
    """Return a pandas DataFrame with the columns of a result.

    Times are a column, not the index, because both limits of an event stand at the same time. ``frame.attrs["units"]``
    holds the unit of each column.

    Parameters
    ----------
    result : Outcome

    Raises
    ------
    ImportError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError as missing:
        raise ImportError("to_frame needs pandas: pip install 'stickslip[frames]'") from missing
    frame, known = pandas.DataFrame(columns(result)), column_units(result)
    frame.attrs["units"] = {name: known[name] for name in frame.columns}
    return frame


# -- one name for two things --------------------------------------------------------------------------------


class _Output:
    """``output(block)`` is a quantity; ``output.to_csv`` and its sisters write results.

    Parameters
    ----------
    block : str
        Name of a block.
    index : int
        Which of its outputs, from 0 on.

    Raises
    ------
    TypeError, ValueError
        If the name is no name, or the number no number from 0 on.
    """

    def __call__(self, block: str, index: int = 0) -> Quantity:
        """Return an output of a block as a quantity.

        Parameters
        ----------
        block : str
            Name of a block.
        index : int
            Which output, from 0 on.

        Raises
        ------
        TypeError, ValueError
            If the name is no name, or the number no number from 0 on.
        """
        return output_of(block, index)

    @property
    def columns(self) -> Any:
        """`stickslip.results.files.columns`."""
        return columns

    @property
    def column_units(self) -> Any:
        """`stickslip.results.files.column_units`."""
        return column_units

    @property
    def summary(self) -> Any:
        """`stickslip.results.files.summary`."""
        return summary

    @property
    def to_csv(self) -> Any:
        """`stickslip.results.files.to_csv`."""
        return to_csv

    @property
    def to_json(self) -> Any:
        """`stickslip.results.files.to_json`."""
        return to_json

    @property
    def to_frame(self) -> Any:
        """`stickslip.results.files.to_frame`."""
        return to_frame

    @property
    def save(self) -> Any:
        """`stickslip.results.files.save`."""
        return save

    @property
    def read(self) -> Any:
        """`stickslip.results.files.read`."""
        return read


output = _Output()


# -- without loss -----------------------------------------------------------------------------------------


def save(result: Outcome, path: Target) -> None:
    """Write a result as npz, from which `read` brings back all of it.

    Beside what `read` needs, the file holds ``t``, ``y``, ``force``, ``breakaway`` and ``mode`` (a row per
    contact), so that it can be read without this package.

    Parameters
    ----------
    result : Outcome
        Signals and laws made of code are not written; `read` then asks for the scene.
    path : path
        Written as it stands, whatever its suffix.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    samples = result.samples
    system, parts = samples.system, samples.trajectory.parts
    pieces = [part for part in parts if isinstance(part, Piece)]
    arrays: dict[str, Any] = {"t": samples.t, "y": samples.y, "piece_of": samples.piece_of}
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
    about = _how_it_ended(result) | {
        "format": _FORMAT,
        "pieces": len(pieces),
        "patchworks": [k for k, part in enumerate(parts) if isinstance(part, Patchwork)],
        "span": [start, stop],
        "stepped": stepped,
    }
    moving = [*system.names, *(drive.name for drive in system.scene.drives)]
    about["positions"] = [moving[i] for i in system.placed] if system.watched else []
    about["scene"] = _scene_to_dict(system.scene)
    arrays["about"] = np.array(json.dumps(about))
    with Path(path).open("wb") as file:
        np.savez_compressed(file, **arrays)


@dataclass(frozen=True)
class Kept:
    """What a file holds of a result."""

    samples: Samples
    events: list[Event]
    success: bool
    status: int
    message: str
    stats: dict[str, Any]


def read(path: Target, scene: Scene | None = None) -> Kept:
    """Return what `save` wrote.

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
    if known not in _READS:
        raise ValueError(f"load: {path} has format {known}, this version reads {_FORMAT}; update stickslip")
    start, stop = about["span"]
    simulated = _scene_of(about, scene, path)
    known = {name for name in about.get("positions", ()) if name in System(simulated).index}
    system = System(simulated, [position(name) for name in sorted(known)])
    if (system.size, system.m) != (data["y"].shape[0], data["force"].shape[0]):
        raise ValueError(f"load: {path} holds the motion of another scene than the one given")
    parts: list[Piece | Patchwork] = list(_pieces(data, about["pieces"]))
    for k in about.get("patchworks", []):
        own = {name.split(".", 2)[2]: data[name] for name in data if name.startswith(f"patchwork.{k}.")}
        parts.insert(k, Patchwork.from_arrays(system, own))
    trajectory = Trajectory(system, (start, stop, about["stepped"]), Pieces.of(parts))
    samples = Samples(trajectory, data["t"], data["y"], data["piece_of"].astype(np.intp))
    events = [_event_from_dict(row) for row in about["events"]]
    return Kept(samples, events, about["success"], about["status"], about["message"], about["stats"])


def _pieces(data: Mapping[str, Any], count: int) -> tuple[Piece, ...]:
    own = {name: _unpacked(f"piece.{name}", data, count) for name in _OF_PIECE}
    of_path = {name: _unpacked(f"path.{name}", data, count) for name in _OF_PATH}
    found = []
    for k in range(count):
        values: dict[str, Any] = {name: of_path[name][k] for name in _OF_PATH}
        path = None if values["taus"] is None else Steps(**values)
        found.append(Piece(path=path, **{name: own[name][k] for name in _OF_PIECE}))
    return tuple(found)


def _packed(name: str, values: list[Any]) -> dict[str, NDArray[Any]]:
    """Return arrays that hold a list of numbers or arrays, some of which may be None."""
    present = np.array([value is not None for value in values], dtype=bool)
    there = [value for value in values if value is not None]
    rows = [np.asarray(value) for value in there]
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
