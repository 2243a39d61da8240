"""Parameters from measurements: least squares with exact gradients through events."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.checks import finite, numbers, whole
from stickslip.model.scene import Scene
from stickslip.simulation.arguments import between
from stickslip.simulation.result import Result, SimulationError
from stickslip.studies.derivatives.directions import along_parameter
from stickslip.studies.derivatives.sensitivities import from_variation
from stickslip.studies.derivatives.variations import Variation, simulated
from stickslip.studies.fits import Fit, Measured
from stickslip.studies.parameters import Parameter, named_parameters, with_values

_QUANTITIES = ("velocity", "position", "force")
_SCREENED = 6
"""Random points for each start, of which the best are taken."""

_EARLY = 0.3
"""Part of the time that is fitted first: phases of later events cannot be a turn off then."""

_ROUGH, _STEPS = 15, 60
"""Most steps of a rough search, and of one for the solution."""

_REFUSED = 1e6
"""Weighted residual where the scene cannot be simulated."""


def fit(
    scene: Scene,
    parameters: Iterable[str] | Mapping[str, tuple[float, float]],
    data: Mapping[str, Sequence[Any]],
    *,
    starts: int = 8,
    seed: int = 0,
    method: str = "auto",
    rtol: float = 1e-9,
    atol: float = 1e-11,
) -> Fit:
    """Return the parameters with which a scene moves as measured, and how well they are determined.

    Least squares by `scipy.optimize.least_squares` with the exact derivatives of `sensitivities`. Where bounds are
    given, the search starts from several random points within them; each start fits the beginning of the data first.

    Parameters
    ----------
    scene : Scene
        Starts at t = 0 as the measured motion does. Its own values are the first start.
    parameters : sequence of str, or dict of str to (float, float)
        Names as `sensitivities` takes them, with bounds where it is a dict.
    data : dict of str to (times, values) or (times, values, sigma)
        ``"BODY.velocity"``, ``"BODY.position"`` or ``"CONTACT.force"``; sigma is the standard deviation of the noise, a
        number or one for each value. Without it all values of a quantity count alike, as parts of their range.
    starts : int
        How many points the search starts from, where there are bounds.
    seed : int
        Of the random points.
    method, rtol, atol
        As `simulate` takes them.

    Raises
    ------
    ValueError, TypeError
        If an argument is not usable.
    SimulationError
        If no start can be simulated.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"fit: scene must be a Scene, got {type(scene).__name__}")
    named = named_parameters(scene, parameters, "fit")
    low, high = _bounds(parameters, named)
    measured = _measured(scene, data)
    starts, seed = whole(starts, "fit: starts", 1), whole(seed, "fit: seed")
    count = sum(one.t.size for one in measured)
    if count < len(named):
        raise ValueError(
            f"fit: {count} measured values cannot determine {len(named)} parameters; give more data"
        )
    options = {"method": method, "rtol": between("rtol", rtol, 1e-14, 0.1), "atol": atol}
    problem = _Problem(scene, named, (low, high), measured, options)
    firsts = [np.clip([one.value for one in named], low, high)]
    if starts > 1 and np.isfinite(low).all() and np.isfinite(high).all():
        firsts += _screened(problem, starts - 1, np.random.default_rng(seed))
    ends = _searched(problem, firsts)
    if not ends:
        raise ValueError("fit: none of the starts can be simulated; look at the scene and the bounds")
    polished = _least(problem, ends[0][0], problem.stop, _STEPS, 1e-12)
    return problem.fitted((polished or ends[0])[0], tuple(ends))


def _bounds(parameters: Any, named: list[Parameter]) -> tuple[Array, Array]:
    low, high = np.full(len(named), -np.inf), np.full(len(named), np.inf)
    if not isinstance(parameters, Mapping):
        return low, high
    for k, one in enumerate(named):
        given = parameters[one.name]
        if given is None:
            continue
        if isinstance(given, str) or not isinstance(given, Sequence) or len(given) != 2:
            raise TypeError(f"fit: bounds of {one.name!r} must be (low, high), got {given!r}")
        low[k], high[k] = (finite(x, f"fit: bounds of {one.name!r}") for x in given)
        if not low[k] < high[k]:
            raise ValueError(f"fit: bounds of {one.name!r} must rise, got {given!r}")
    return low, high


def _measured(scene: Scene, data: Any) -> tuple[Measured, ...]:
    if not isinstance(data, Mapping) or not data:
        raise TypeError(f"fit: data must map names such as 'block.velocity' to (times, values), got {data!r}")
    ends = {one.name for one in (*scene.bodies, *scene.drives)}
    rows = {row.name for row in scene.rows}
    found = []
    for name, series in data.items():
        of, _, quantity = str(name).rpartition(".")
        known = rows if quantity == "force" else ends
        if quantity not in _QUANTITIES or of not in known:
            raise ValueError(
                f"fit: data {name!r}: write 'BODY.velocity', 'BODY.position' or 'CONTACT.force'; "
                f"known are {', '.join(sorted(map(repr, ends | rows))[:10])}; for the pull of a spring tie its end, a "
                "body of inertia 0, to what holds it, and write 'TIE.force'"
            )
        if not isinstance(series, (tuple, list)) or len(series) not in (2, 3):
            raise TypeError(f"fit: data {name!r} must be (times, values) or (times, values, sigma)")
        t, values = (
            numbers(x, f"fit: data {name!r}: {what}")
            for x, what in zip(series, ("times", "values"), strict=False)
        )
        if t.size != values.size or not t.size:
            raise ValueError(
                f"fit: data {name!r}: times and values must be equally many, got {t.size} and {values.size}"
            )
        if not (np.isfinite(t).all() and np.isfinite(values).all()):
            raise ValueError(f"fit: data {name!r} must be finite; leave out what is missing")
        if np.any(np.diff(t) <= 0) or t[0] < 0:
            raise ValueError(f"fit: data {name!r}: times must rise and not be negative; sort them")
        sigma = None
        if len(series) == 3 and series[2] is not None:
            sigma = np.broadcast_to(np.asarray(series[2], dtype=float), t.shape)
            if not (np.isfinite(sigma).all() and np.all(sigma > 0)):
                raise ValueError(f"fit: data {name!r}: sigma must be positive")
        found.append(Measured(str(name), t, values, sigma))
    if len({one.sigma is None for one in found}) > 1:
        raise ValueError("fit: give sigma for all data or for none")
    return tuple(found)


class _Problem:
    """Weighted residuals and their derivatives, and the bounds of the parameters."""

    def __init__(
        self,
        scene: Scene,
        parameters: list[Parameter],
        bounds: tuple[Array, Array],
        measured: tuple[Measured, ...],
        options: dict[str, Any],
    ) -> None:
        self._scene, self._parameters, self._measured, self._options = scene, parameters, measured, options
        self.bounds = bounds
        self.stop = max(float(one.t[-1]) for one in measured)
        if self.stop <= 0:
            raise ValueError("fit: all data are at t = 0; give data over time")
        self.early = _EARLY * self.stop
        self.has_sigma = measured[0].sigma is not None
        self._weights = [
            np.full(one.t.size, 1.0 / (float(np.ptp(one.values)) or 1.0))
            if one.sigma is None
            else 1.0 / one.sigma
            for one in measured
        ]
        self._last: tuple[bytes, float, Result] | None = None
        self.reasons: tuple[str, ...] = ()

    def _at(self, x: Array) -> list[Parameter]:
        """Return the parameters; a Coulomb coefficient beyond a static one that is not fitted takes it along."""
        own = {(one.place, one.steps) for one in self._parameters}
        moved = [
            one.with_static(self._scene, value)
            for one, value in zip(self._parameters, x.tolist(), strict=True)
        ]
        return [
            one if (new.place, new.along) in own else new
            for one, new in zip(self._parameters, moved, strict=True)
        ]

    def scene_at(self, x: Array) -> Scene:
        """Return the scene with other values."""
        return with_values(self._scene, self._at(x), x.tolist())

    def _result(self, x: Array, stop: float) -> Result:
        key = x.tobytes()
        if self._last is None or self._last[:2] != (key, stop):
            self._last = key, stop, simulated(self.scene_at(x), (0.0, stop), **self._options)
        return self._last[2]

    def _until(self, stop: float) -> list[tuple[Measured, Array]]:
        """Return what was measured up to a time, and its weights."""
        counts = [int(np.searchsorted(one.t, stop, side="right")) for one in self._measured]
        return [
            (Measured(one.name, one.t[:count], one.values[:count], None), weight[:count])
            for one, weight, count in zip(self._measured, self._weights, counts, strict=True)
            if count
        ]

    def residuals(self, x: Array, stop: float) -> Array:
        """Return the weighted residuals up to a time; large ones where the scene cannot be simulated."""
        some = self._until(stop)
        try:
            result = self._result(x, stop)
        except (ValueError, SimulationError):
            return np.full(sum(one.t.size for one, _ in some), _REFUSED)
        return np.concatenate([(one.read(result) - one.values) * weight for one, weight in some])

    def slopes(self, x: Array, stop: float) -> Array:
        """Return the derivatives of the weighted residuals, 0 where none exist."""
        result = self._result(x, stop)
        scene = result.scene
        directions = [along_parameter(scene, one.at(scene), result.trajectory, "fit") for one in self._at(x)]
        found = from_variation(Variation(result, directions))
        self.reasons = found.reasons
        some = self._until(stop)
        read = [getattr(found, one.quantity)(one.of, one.t) * weight[:, None] for one, weight in some]
        return np.asarray(np.nan_to_num(np.concatenate(read)))

    def fitted(self, x: Array, ends: tuple[tuple[Array, float], ...]) -> Fit:
        """Return the fit at a solution."""
        residuals, slopes = self.residuals(x, self.stop), self.slopes(x, self.stop)
        cost = 0.5 * float(residuals @ residuals)
        spread = 1.0 if self.has_sigma else 2 * cost / max(residuals.size - x.size, 1)
        size = np.maximum(np.abs(x), 1e-300)
        _, sizes, lines = np.linalg.svd(slopes * size, full_matrices=False)
        # a derivative whose square is 0 tells nothing, either
        lost = sizes <= max(1e-12 * sizes.max(initial=0.0), 1e-150)
        inverse = np.where(lost, 0.0, 1.0 / np.where(lost, 1.0, sizes) ** 2)
        covariance = (lines.T * inverse) @ lines * np.outer(size, size) * spread
        blind = (np.abs(lines[lost]) > 1e-6).any(axis=0)
        covariance[blind, blind] = np.inf
        scene = self.scene_at(x)
        return Fit(
            tuple(one.name for one in self._parameters),
            x,
            tuple(one.unit(scene) for one in self._parameters),
            covariance,
            scene,
            self._result(x, self.stop),
            self._measured,
            cost,
            ends,
            self.reasons,
        )


def _screened(problem: _Problem, count: int, random: np.random.Generator) -> list[Array]:
    """Return the best of some random points within the bounds."""
    low, high = problem.bounds
    points = low + (high - low) * random.random((_SCREENED * count, low.size))
    costs = [float(np.sum(problem.residuals(x, problem.early) ** 2)) for x in points]
    return [points[k] for k in np.argsort(costs, kind="stable")[:count].tolist()]


def _searched(problem: _Problem, firsts: list[Array]) -> list[tuple[Array, float]]:
    """Return where the searches from some starts end, and their costs there, best first.

    Each fits the beginning of the data first; the better half of them goes on to all of it.
    """
    if len(firsts) == 1:
        found = [_least(problem, firsts[0], problem.stop, _STEPS, 1e-6)]
    else:
        early = [_least(problem, first, problem.early, _ROUGH, 1e-4) for first in firsts]
        begun = sorted((one for one in early if one is not None), key=itemgetter(1))
        begun = begun[: max(2, (len(begun) + 1) // 2)]
        found = [_least(problem, x, problem.stop, _ROUGH, 1e-4) for x, _ in begun]
    return sorted((one for one in found if one is not None), key=itemgetter(1))


def _least(
    problem: _Problem, first: Array, stop: float, steps: int, tolerance: float
) -> tuple[Array, float] | None:
    """Return where least squares of the data up to a time lead, and the cost there; None for a start that fails."""
    from scipy.optimize import least_squares

    if np.any(problem.residuals(first, stop) == _REFUSED):
        return None
    inside = np.clip(first, *problem.bounds)
    found = least_squares(
        lambda x: problem.residuals(x, stop),
        inside,
        lambda x: problem.slopes(x, stop),
        bounds=problem.bounds,
        x_scale=np.where(inside == 0, 1.0, np.abs(inside)),
        max_nfev=steps,
        xtol=tolerance,
        ftol=tolerance,
        gtol=1e-15,
    )
    return found.x, float(found.cost)
