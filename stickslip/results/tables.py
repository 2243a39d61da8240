"""Results as tables: CSV and JSON for reading elsewhere, pandas frames."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.system import System
from stickslip.model.checks import file_path, flag
from stickslip.results.in_a_row import joined
from stickslip.results.outcome import Outcome, Target
from stickslip.results.readable import Readable, check_result
from stickslip.results.samples import Samples
from stickslip.results.units import units as units_of


def columns(result: Readable) -> dict[str, NDArray[Any]]:
    """Return motion, forces, modes, powers and energies of a result, under their names in files.

    Parameters
    ----------
    result : Result or Joined
        In runs in a row, what a run does not have is NaN at its times.

    Returns
    -------
    dict of str to array (n,)
        ``time``; ``velocity NAME`` of bodies and drives, and ``position NAME`` where it is a state; ``force NAME`` and
        ``mode NAME`` of contacts and other rows; ``breakaway NAME``, ``normal NAME``, ``power NAME`` and, counted
        from the start, ``heat NAME`` of contacts; ``output NAME`` of blocks, ``output NAME[0]`` and so on where there
        are several; ``heat of dampers``, ``kinetic energy``, ``spring energy``, ``work of loads`` and ``work of
        drives``; ``lost in impacts`` and ``changes between runs`` where there are any. Heat, energy and work are left
        out where only the outputs were kept.
    """
    check_result(result, "columns")
    systems = [run.samples.system for run in result.runs]
    # a position that is a state in one of several runs is shown in all of them
    placed = {name for one in systems for i, name in enumerate(_moving(one)) if i in one.position_state}
    parts = [_columns(run.samples, placed) for run in result.runs]
    sizes = [run.samples.t.size for run in result.runs]
    names = dict.fromkeys(name for part in parts for name in part)
    found = [{name: joined([part.get(name) for part in parts], sizes) for name in names}]
    if result.is_dense or not result.t.size:
        ledger = result.energy()
        found.append({f"heat {name}": heat for name, heat in ledger.contacts.items()})
        found.append({"heat of dampers": sum(ledger.dampers.values(), np.zeros_like(ledger.t))})
        found.append({"kinetic energy": ledger.kinetic, "spring energy": ledger.spring})
        found.append({"work of loads": ledger.loads, "work of drives": ledger.drives})
        if ledger.impacts:
            found.append({"lost in impacts": sum(ledger.impacts.values(), np.zeros_like(ledger.t))})
        if ledger.changes.any():
            found.append({"changes between runs": ledger.changes})
    return _together(found)


def _together(parts: Iterable[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Return all columns together; no two may have the same name."""
    found: dict[str, NDArray[Any]] = {}
    for part in parts:
        for name in sorted(found.keys() & part.keys()):
            raise ValueError(f"columns: two columns are called {name!r}; give one of the elements another name")
        found |= part
    return found


def _moving(system: System) -> list[str]:
    return [*system.names, *(drive.name for drive in system.scene.drives)]


def _columns(samples: Samples, placed: set[str]) -> dict[str, NDArray[Any]]:
    """Return motion, forces, modes, powers and outputs of one run, with positions of bodies and drives in `placed`."""
    system = samples.system
    moving = _moving(system)
    names = [row.name for row in system.rows]
    frictional = [row.name for row, has in zip(system.rows, system.is_friction.tolist(), strict=True) if has]
    found: list[dict[str, NDArray[Any]]] = [
        {"time": samples.t},
        {f"velocity {name}": samples.velocity(name) for name in moving},
        {f"position {name}": samples.position(name) for name in moving if name in placed},
        {f"force {name}": samples.force(name) for name in names},
        {f"breakaway {name}": samples.breakaway(name) for name in frictional},
        {f"mode {name}": samples.mode(name) for name in names},
        {f"normal {name}": samples.normal(name) for name in frictional},
        {f"power {name}": samples.power(name) for name in frictional},
    ]
    for name in system.blocks:
        outputs = np.atleast_2d(samples.outputs_of(name))
        heads = [f"output {name}"] if len(outputs) == 1 else [f"output {name}[{k}]" for k in range(len(outputs))]
        found.append(dict(zip(heads, outputs, strict=True)))
    return _together(found)


def column_units(result: Readable) -> dict[str, str]:
    """Return the unit of each column; modes have none, and units of blocks are not known.

    The scene or its bodies say whether they rotate or move along lines; where neither does, both units are named.

    Parameters
    ----------
    result : Result or Joined
    """
    check_result(result, "column_units")
    scene = result.scene
    found = {"time": "s"}
    for one in (*scene.bodies, *scene.drives):
        unit = units_of(scene, one)
        found |= {f"velocity {one.name}": unit.velocity, f"position {one.name}": unit.position}
    for row in scene.rows:
        force = units_of(scene, row).force
        found |= {f"force {row.name}": force, f"breakaway {row.name}": force, f"mode {row.name}": ""}
        found |= {f"normal {row.name}": "N", f"power {row.name}": "W", f"heat {row.name}": "J"}
    energies = ("heat of dampers", "kinetic energy", "spring energy", "work of loads", "work of drives")
    return found | dict.fromkeys((*energies, "lost in impacts", "changes between runs"), "J")


def to_csv(result: Readable, path: Target, *, units: bool | None = None) -> None:
    """Write the columns of a result as CSV, a line per time; numbers keep all their digits.

    Parameters
    ----------
    result : Result or Joined
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
    target, found, known = file_path(path, "to_csv"), columns(result), column_units(result)
    with_units = None not in result.scene.motions.values() if units is None else flag(units, "to_csv: units")
    heads = [f"{name} [{known[name]}]" if with_units and known.get(name) else name for name in found]
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(heads)
        writer.writerows(zip(*(column.tolist() for column in found.values()), strict=True))


def summary(result: Readable) -> dict[str, Any]:
    """Return outcome, events, counts and the columns at the last time as plain data.

    Parameters
    ----------
    result : Result or Joined
        Runs in a row give a list ``runs``, with outcome, events and counts of each.
    """
    check_result(result, "summary")
    ended = [how_it_ended(run) for run in result.runs]
    data: dict[str, Any] = ended[0] if len(ended) == 1 else {"runs": ended}
    if result.t.size:
        last = result.sample(result.t[-1:]) if result.is_dense else result
        data["final"] = {name: _plain(column[-1]) for name, column in columns(last).items()}
        known = column_units(result)
        data["units"] = {name: known.get(name, "") for name in data["final"]}
    return data


def how_it_ended(result: Outcome) -> dict[str, Any]:
    """Return outcome, events and counts as plain data."""
    return {
        "success": bool(result.success),
        "status": int(result.status),
        "message": result.message,
        "events": [asdict(one) | {"before": one.before.name, "after": one.after.name} for one in result.events],
        "stats": {name: _plain(value) for name, value in result.stats.items()},
    }


def to_json(result: Readable, path: Target) -> None:
    """Write outcome, events, counts and the state at the last time as JSON.

    Parameters
    ----------
    result : Result or Joined
    path : path

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    target = file_path(path, "to_json")
    target.write_text(json.dumps(summary(result), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def to_frame(result: Readable) -> Any:
    """Return a pandas DataFrame with the columns of a result.

    Times are a column, not the index, because both limits of an event stand at the same time. ``frame.attrs["units"]``
    holds the unit of each column.

    Parameters
    ----------
    result : Result or Joined

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
    frame.attrs["units"] = {name: known.get(name, "") for name in frame.columns}
    return frame


def _plain(value: Any) -> Any:
    """Return a value as JSON knows it; numbers that are not finite become text."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [_plain(item) for item in value]
    return value
