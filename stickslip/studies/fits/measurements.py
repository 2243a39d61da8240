"""What was measured: times and values of quantities by name."""

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
        raise TypeError(
            f"{what}: data must map names such as 'block.velocity' to (times, values), got {data!r}"
        )
    ends = {one.name for one in (*scene.bodies, *scene.drives)}
    rows = {row.name for row in scene.rows}
    found = []
    for name, series in data.items():
        of, _, quantity = str(name).rpartition(".")
        known = rows if quantity == "force" else ends
        if quantity not in _QUANTITIES or of not in known:
            raise ValueError(
                f"{what}: data {name!r}: write 'BODY.velocity', 'BODY.position' or 'CONTACT.force'; "
                f"known are {', '.join(sorted(map(repr, ends | rows))[:10])}; for the pull of a spring tie its end, a "
                "body of inertia 0, to what holds it, and write 'TIE.force'"
            )
        if not isinstance(series, (tuple, list)) or len(series) not in (2, 3):
            raise TypeError(f"{what}: data {name!r} must be (times, values) or (times, values, sigma)")
        t, values = (
            numbers(x, f"{what}: data {name!r}: {part}")
            for x, part in zip(series, ("times", "values"), strict=False)
        )
        if not t.size:
            raise ValueError(f"{what}: data {name!r} has no times; give one at least")
        if t.size != values.size:
            raise ValueError(
                f"{what}: data {name!r}: times and values must be equally many, got {t.size} and {values.size}"
            )
        if not (np.isfinite(t).all() and np.isfinite(values).all()):
            raise ValueError(f"{what}: data {name!r} must be finite; leave out what is missing")
        if np.any(np.diff(t) <= 0) or t[0] < 0:
            raise ValueError(f"{what}: data {name!r}: times must rise and not be negative; sort them")
        sigma = None
        if len(series) == 3 and series[2] is not None:
            sigma = numbers(np.atleast_1d(series[2]), f"{what}: data {name!r}: sigma")
            if sigma.size not in (1, t.size):
                raise ValueError(
                    f"{what}: data {name!r}: sigma must be one number or one for each of the {t.size} values, "
                    f"got {sigma.size}"
                )
            sigma = np.broadcast_to(sigma, t.shape)
            if not (np.isfinite(sigma).all() and np.all(sigma > 0)):
                raise ValueError(f"{what}: data {name!r}: sigma must be positive")
        found.append(Measured(str(name), t, values, sigma))
    if max(float(one.t[-1]) for one in found) <= 0:
        raise ValueError(f"{what}: all data are at t = 0; give data over time")
    return tuple(found)


def weights_of(measured: list[tuple[Measured, ...]]) -> list[list[Array]]:
    """Return the weights of all values: of one quantity they are parts of its range over all records."""
    everything: dict[str, list[Array]] = {}
    for one in chain(*measured):
        everything.setdefault(one.name, []).append(one.values)
    ranges = {name: float(np.ptp(np.concatenate(values))) or 1.0 for name, values in everything.items()}
    return [
        [
            np.full(one.t.size, 1.0 / ranges[one.name]) if one.sigma is None else 1.0 / one.sigma
            for one in record
        ]
        for record in measured
    ]
