"""What a sweep keeps: values on a parameter grid, and a file from which it resumes."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np

Index = tuple[int, ...]
Point = dict[str, Any]
Values = dict[str, np.ndarray]
GridPoint = tuple[Index, Point]


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult:
    """Values on a parameter grid.

    Parameters
    ----------
    parameters : dict
        Name -> values, one array per axis of the grid.
    values : dict
        Name -> array of shape grid + shape of one value; NaN where a point failed or is pending.
    failures : dict
        Grid index -> message.
    pending : tuple
        Grid indices that were not reached (after an interrupt).
    """

    parameters: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    failures: dict[Index, str]
    pending: tuple[Index, ...] = ()

    @property
    def shape(self) -> Index:
        """Shape of the grid."""
        return tuple(len(axis) for axis in self.parameters.values())

    def value(self, name: str | None = None) -> np.ndarray:
        """Return the array of a name, or the only one.

        Raises
        ------
        ValueError
            If there is no such name, or no name is given and there are several.
        """
        if name is None and len(self.values) == 1:
            return next(iter(self.values.values()))
        if not isinstance(name, str) or name not in self.values:
            raise ValueError(f"value: no value {name!r}; choose from {', '.join(self.values)}")
        return self.values[name]

    def points(self) -> Iterator[tuple[Point, dict[str, Any]]]:
        """Iterate over the points of the grid: parameters and values, both by name."""
        for index, point in grid_points(self.parameters):
            yield point, {name: array[index] for name, array in self.values.items()}

    def to_xarray(self) -> Any:
        """Return an xarray Dataset with the parameters as coordinates.

        Raises
        ------
        ImportError
            If xarray is not installed.
        """
        try:
            import xarray
        except ImportError as missing:
            raise ImportError("to_xarray needs xarray: pip install 'stickslip[frames]'") from missing
        axes, data = tuple(self.parameters), {}
        for name, array in self.values.items():
            inner = [f"{name}_{k}" for k in range(array.ndim - len(axes))]
            data[name] = ((*axes, *(_other_than(axes, one) for one in inner)), array)
        return xarray.Dataset(data, coords={name: (name, axis) for name, axis in self.parameters.items()})

    def __str__(self) -> str:
        """Return a summary: axes, extent of the values, the first failures."""
        total = math.prod(self.shape)
        lines = [f"sweep of {total} points: {len(self.failures)} failed, {len(self.pending)} pending"]
        for name, axis in self.parameters.items():
            others = f" .. {axis[-1]} ({len(axis)} values)" if len(axis) > 1 else ""
            lines.append(f"  {name}: {axis[0]}{others}")
        for name, array in self.values.items():
            finite = array[np.isfinite(array)]
            extent = f"{finite.min():.6g} .. {finite.max():.6g}" if finite.size else "no finite value"
            lines.append(f"  -> {name}: {extent}")
        for index, message in islice(self.failures.items(), 3):
            at = zip(self.parameters.items(), index, strict=True)
            where = ", ".join(f"{name}={axis[i]}" for (name, axis), i in at)
            lines.append(f"  failed at {where}: {message.splitlines()[0]}")
        if len(self.failures) > 3:
            lines.append(f"  and {len(self.failures) - 3} more in .failures")
        return "\n".join(lines)

    __repr__ = __str__


def _other_than(names: Collection[str], name: str) -> str:
    """Return a name that is not among `names`: with as many underscores behind it as it needs."""
    while name in names:
        name += "_"
    return name


def grid_points(parameters: Mapping[str, np.ndarray]) -> Iterator[GridPoint]:
    """Iterate over grid indices and points, the last parameter fastest."""
    axes = [list(enumerate(axis.tolist())) for axis in parameters.values()]
    for combination in product(*axes):
        index = tuple(i for i, _ in combination)
        yield index, {name: value for name, (_, value) in zip(parameters, combination, strict=True)}


class SweepLog:
    """Finished points in a file, one JSON line each, from which a later sweep of the same grid resumes."""

    def __init__(self, path: Path, parameters: dict[str, np.ndarray], version: str) -> None:
        """Name the file, the grid, and what is computed on it."""
        self.path = path
        self.axes = {name: axis.tolist() for name, axis in parameters.items()}
        try:
            text = json.dumps(list(self.axes.items())) + version
            digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        except TypeError as exception:
            raise TypeError(f"sweep: save needs parameters that are numbers or texts ({exception})") from None
        self.head = f'{{"grid": "{digest}", '

    def load(self) -> dict[Index, Values | str]:
        """Return the points that succeeded, and cut off a last line that a crash left torn."""
        done: dict[Index, Values | str] = {}
        content = self.path.read_bytes() if self.path.exists() else b""
        *lines, torn = content.split(b"\n")
        head = self.head.encode()
        if torn[: len(head)] != head[: len(torn)] or not all(line.startswith(head) for line in lines):
            raise ValueError(
                f"sweep: {str(self.path)!r} does not belong to this sweep of {', '.join(self.axes)}: it has "
                "other parameters or values, was saved of another function (scene, time span, options), or is "
                "something else. Give another file, or the same grid and function"
            )
        for line in lines:
            record = json.loads(line)
            if "values" in record:
                values = record["values"].items()
                done[tuple(record["index"])] = {name: np.array(value, dtype=float) for name, value in values}
        if torn:
            os.truncate(self.path, len(content) - len(torn))
        return done

    def append(self, index: Index, outcome: Values | str) -> None:
        """Add a finished point."""
        record: dict[str, Any] = {"index": index}
        record["point"] = {name: axis[i] for (name, axis), i in zip(self.axes.items(), index, strict=True)}
        if isinstance(outcome, str):
            record["failure"] = outcome
        else:
            record["values"] = {name: array.tolist() for name, array in outcome.items()}
        self.file.write(self.head + json.dumps(record)[1:] + "\n")
        self.file.flush()

    def __enter__(self) -> None:
        """Open the file to append."""
        self.file = self.path.open("a", encoding="utf-8", newline="\n")

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self.file.close()


def collect(parameters: dict[str, np.ndarray], done: Mapping[Index, Values | str]) -> SweepResult:
    """Return the outcomes as arrays; the first point that succeeded sets the names and shapes."""
    shape = tuple(len(axis) for axis in parameters.values())
    failures: dict[Index, str] = {}
    pending: list[Index] = []
    expected: dict[str, Index] | None = None
    values: Values = {}
    for index in np.ndindex(shape):
        outcome = done.get(index)
        if outcome is None:
            pending.append(index)
            continue
        if isinstance(outcome, str):
            failures[index] = outcome
            continue
        found = {name: array.shape for name, array in outcome.items()}
        if expected is None:
            expected = found
            values = {name: np.full(shape + inner, np.nan) for name, inner in found.items()}
        if found != expected:
            failures[index] = f"ValueError: the function returned shapes {found}, before {expected}"
            continue
        for name, array in outcome.items():
            values[name][index] = array
    return SweepResult(parameters, values or {"value": np.full(shape, np.nan)}, failures, tuple(pending))
