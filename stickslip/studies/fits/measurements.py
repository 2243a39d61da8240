"""Measurements: times and values of quantities by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.checks import numbers
from stickslip.model.scene import Scene
from stickslip.simulation.result import Result

_QUANTITIES = ("velocity", "position", "force")


@dataclass(frozen=True)
class Measured:
    """One measured quantity over time.

    Attributes
    ----------
    name : str
        ``"BODY.velocity"``, ``"BODY.position"`` or ``"CONTACT.force"``.
    t, values : array (k,)
        Times in s and what was measured.
    sigma : array (k,) or None
        Standard deviations of the noise, where they are known.
    """

    name: str
    t: Array = field(repr=False)
    values: Array = field(repr=False)
    sigma: Array | None = field(repr=False)

    @property
    def of(self) -> str:
        """The name of the body or row."""
        return self.name.rpartition(".")[0]

    @property
    def quantity(self) -> str:
        """velocity, position or force."""
        return self.name.rpartition(".")[2]

    def read(self, result: Result) -> Array:
        """Return the quantity of a result at the measured times."""
        return np.asarray(getattr(result.sample(self.t), self.quantity)(self.of))


def measured_in(scene: Scene, data: Any, what: str) -> tuple[Measured, ...]:
    """Return what was measured of a scene, checked; `what` begins the message where it is not usable."""
    if not isinstance(data, Mapping) or not data:
        raise TypeError(f"{what}: data must map names such as 'block.velocity' to (times, values), got {data!r}")
    for name in data:
        _check_name(scene, name, what)
    found = tuple(_measured(name, series, f"{what}: data {name!r}") for name, series in data.items())
    if max(float(one.t[-1]) for one in found) <= 0:
        raise ValueError(f"{what}: all data are at t = 0; give data over time")
    return found


def _check_name(scene: Scene, name: Any, what: str) -> None:
    """Refuse a name that belongs to no quantity of the scene."""
    ends = {one.name for one in (*scene.bodies, *scene.drives)}
    rows = {row.name for row in scene.rows}
    of, _, quantity = str(name).rpartition(".")
    if quantity not in _QUANTITIES or of not in (rows if quantity == "force" else ends):
        raise ValueError(
            f"{what}: data {name!r}: write 'BODY.velocity', 'BODY.position' or 'CONTACT.force'; "
            f"known are {', '.join(sorted(map(repr, ends | rows))[:10])}; for the pull of a spring tie its end, a "
            "body of inertia 0, to what holds it, and write 'TIE.force'"
        )


def _measured(name: Any, series: Any, label: str) -> Measured:
    """Return what was measured of one quantity, checked; messages begin with its label."""
    if not isinstance(series, (tuple, list)) or len(series) not in (2, 3):
        raise TypeError(f"{label} must be (times, values) or (times, values, sigma)")
    t, values = numbers(series[0], f"{label}: times"), numbers(series[1], f"{label}: values")
    if not t.size:
        raise ValueError(f"{label} has no times; give one at least")
    if t.size != values.size:
        raise ValueError(f"{label}: times and values must be equally many, got {t.size} and {values.size}")
    if not (np.isfinite(t).all() and np.isfinite(values).all()):
        raise ValueError(f"{label} must be finite; leave out what is missing")
    if np.any(np.diff(t) <= 0) or t[0] < 0:
        raise ValueError(f"{label}: times must rise and not be negative; sort them")
    sigma = series[2] if len(series) == 3 else None
    return Measured(str(name), t, values, None if sigma is None else _noise(sigma, t.size, label))


def _noise(sigma: Any, count: int, label: str) -> Array:
    """Return a standard deviation for each of so many values, checked."""
    given = numbers(np.atleast_1d(sigma), f"{label}: sigma")
    if given.size not in (1, count):
        raise ValueError(f"{label}: sigma must be one number or one for each of the {count} values, got {given.size}")
    if not (np.isfinite(given).all() and np.all(given > 0)):
        raise ValueError(f"{label}: sigma must be positive")
    return np.broadcast_to(given, (count,))


def weights_of(measured: list[tuple[Measured, ...]]) -> list[list[Array]]:
    """Return the weights of all values: 1 / sigma, or without it 1 / the range of the quantity in all records."""
    everything: dict[str, list[Array]] = {}
    for one in chain(*measured):
        everything.setdefault(one.name, []).append(one.values)
    ranges = {name: float(np.ptp(np.concatenate(values))) or 1.0 for name, values in everything.items()}
    return [
        [np.full(one.t.size, 1.0 / ranges[one.name]) if one.sigma is None else 1.0 / one.sigma for one in record]
        for record in measured
    ]
