"""Parameters from measurements: least squares with exact gradients through events."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.checks import finite, in_order, whole
from stickslip.model.checks import names as checked_names
from stickslip.model.scene import Scene
from stickslip.simulation.arguments import between
from stickslip.studies.fits.fitted import Fit
from stickslip.studies.fits.measurements import Measured, measured_in, weights_of
from stickslip.studies.fits.residuals import REFUSED, Problem, RecordRun
from stickslip.studies.parameters import Parameter, named_parameters

_OF_ONE = re.compile(r"(records\[\d+\])\.(.*)")  # the name of a parameter of a single record
_SCREENED = 6  # random points for each start, of which the best are taken
_EARLY = 0.3  # part of the time that is fitted first: there a phase can hardly be wrong by a whole turn
_ROUGH, _STEPS = 15, 60  # most steps of a rough search, and of one for the solution


def fit(
    scene: Scene | Sequence[Scene],
    parameters: Iterable[str] | Mapping[str, tuple[float, float]],
    data: Mapping[str, Sequence[Any]] | Sequence[Mapping[str, Sequence[Any]]],
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
    scene : Scene, or sequence of Scene
        Starts at t = 0 as the measured motion does. Its own values are the first start. Several records of one
        machine, as at several speeds, are several scenes; the values of the first are the first start.
    parameters : sequence of str, or dict of str to (float, float)
        Names as `sensitivities` takes them, with bounds where it is a dict. Of several records they are common to
        all; ``"records[1].block.position"`` is one of a single record, counted from 0.
    data : dict of str to (times, values) or (times, values, sigma), or a sequence of these, one for each scene
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
    scenes, measured, labels = _records(scene, data)
    names, named = _shared(scenes, parameters, labels)
    low, high = _bounds(parameters, names)
    starts, seed = whole(starts, "fit: starts", 1), whole(seed, "fit: seed")
    count = sum(one.t.size for record in measured for one in record)
    if count < len(names):
        raise ValueError(f"fit: {count} measured values cannot determine {len(names)} parameters; give more data")
    options = {"method": method, "rtol": between("rtol", rtol, 1e-14, 0.1), "atol": atol}
    problem = Problem(
        names,
        (low, high),
        [
            RecordRun(label, one, own, record, weight, options)
            for label, one, own, record, weight in zip(
                labels, scenes, named, measured, weights_of(measured), strict=True
            )
        ],
        measured[0][0].sigma is not None,
    )
    first = {k: one.value for own in reversed(named) for k, one in own.items()}
    firsts = [np.clip([first[k] for k in range(len(names))], low, high)]
    if starts > 1 and np.isfinite(low).all() and np.isfinite(high).all():
        firsts += _screened(problem, starts - 1, np.random.default_rng(seed))
    ends = _searched(problem, firsts)
    if not ends:
        problem.simulate(firsts[0])
        raise ValueError(
            f"fit: no values beside the starts can be simulated: {problem.refusal}; look at the scene and the bounds"
        )
    polished = _least(problem, ends[0][0], 1.0, _STEPS, 1e-12)
    return problem.fitted((polished or ends[0])[0], tuple(ends))


def _records(scene: Any, data: Any) -> tuple[list[Scene], list[tuple[Measured, ...]], list[str]]:
    """Return the scene of each record, what was measured of it, and what the record is called."""
    several = isinstance(scene, Sequence) and not isinstance(scene, str)
    scenes = list(scene) if several else [scene]
    for one in scenes:
        if not isinstance(one, Scene):
            raise TypeError(f"fit: scene must be a Scene or a sequence of them, got {type(one).__name__}")
    given = in_order(data, "fit: data of several scenes", "data, one for each scene") if several else [data]
    if len(scenes) != len(given) or not scenes:
        raise ValueError(
            f"fit: each record needs its scene and its data, got {len(scenes)} scenes and {len(given)} sets of data"
        )
    labels = [f"records[{k}]" for k in range(len(scenes))] if several else [""]
    measured = [measured_in(one, own, _place(label)) for one, own, label in zip(scenes, given, labels, strict=True)]
    if len({one.sigma is None for record in measured for one in record}) > 1:
        raise ValueError("fit: give sigma for all data or for none")
    return scenes, measured, labels


def _place(label: str) -> str:
    """Return the beginning of a message about a record."""
    return f"fit: {label}" if label else "fit"


def _shared(scenes: list[Scene], parameters: Any, labels: list[str]) -> tuple[list[str], list[dict[int, Parameter]]]:
    """Return the names of the parameters, and those of each record by their places among all."""
    names = checked_names(list(parameters) if isinstance(parameters, Mapping) else parameters, "fit: parameters")
    of_one = {name: match for name in names if (match := _OF_ONE.fullmatch(name))} if labels[0] else {}
    for name, match in of_one.items():
        if match[1] not in labels:
            raise ValueError(f"fit: parameter {name!r}: there are {len(labels)} records, counted from 0")
    found = []
    for scene, label in zip(scenes, labels, strict=True):
        own = {
            k: of_one[name][2] if name in of_one else name
            for k, name in enumerate(names)
            if name not in of_one or of_one[name][1] == label
        }
        if names and not own:
            raise ValueError(f"fit: no parameter belongs to {label}; leave the record out")
        found.append(
            dict(zip(own, named_parameters(scene, list(own.values()), _place(label), together=True), strict=True))
        )
    return names, found


def _bounds(parameters: Any, names: list[str]) -> tuple[Array, Array]:
    """Return the lower and upper bounds of the parameters, infinite where none are given."""
    low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    if not isinstance(parameters, Mapping):
        return low, high
    for k, name in enumerate(names):
        given = parameters[name]
        if given is None:
            continue
        if isinstance(given, str) or not isinstance(given, Sequence) or len(given) != 2:
            raise TypeError(f"fit: bounds of {name!r} must be (low, high), got {given!r}")
        low[k], high[k] = (finite(x, f"fit: bounds of {name!r}") for x in given)
        if not low[k] < high[k]:
            raise ValueError(f"fit: bounds of {name!r} must rise, got {given!r}")
    return low, high


def _screened(problem: Problem, count: int, random: np.random.Generator) -> list[Array]:
    """Return the best of some random points within the bounds."""
    low, high = problem.bounds
    points = low + (high - low) * random.random((_SCREENED * count, low.size))
    costs = [float(np.sum(problem.residuals(x, _EARLY) ** 2)) for x in points]
    return [points[k] for k in np.argsort(costs, kind="stable")[:count].tolist()]


def _searched(problem: Problem, firsts: list[Array]) -> list[tuple[Array, float]]:
    """Return where the searches from some starts end, and their costs there, best first.

    Each fits the beginning of the data first; the better half of them goes on to all of it.
    """
    if len(firsts) == 1:
        found = [_least(problem, firsts[0], 1.0, _STEPS, 1e-6)]
    else:
        early = [_least(problem, first, _EARLY, _ROUGH, 1e-4) for first in firsts]
        begun = sorted((one for one in early if one is not None), key=itemgetter(1))
        begun = begun[: max(2, (len(begun) + 1) // 2)]
        found = [_least(problem, x, 1.0, _ROUGH, 1e-4) for x, _ in begun]
    return sorted((one for one in found if one is not None), key=itemgetter(1))


def _least(problem: Problem, first: Array, part: float, steps: int, tolerance: float) -> tuple[Array, float] | None:
    """Return where least squares of a part of the data lead, and the cost there; None for a start that fails.

    A start fails if it cannot be simulated, or if no other values that were tried can.
    """
    from scipy.optimize import least_squares

    tried: list[bool] = []

    def residuals(x: Array) -> Array:
        found = problem.residuals(x, part)
        tried.append(not np.any(found == REFUSED))
        return found

    inside = np.clip(first, *problem.bounds)
    residuals(inside)
    if not tried[0]:
        return None
    found = least_squares(
        residuals,
        inside,
        lambda x: problem.slopes(x, part),
        bounds=problem.bounds,
        x_scale=np.where(inside == 0, 1.0, np.abs(inside)),
        max_nfev=steps,
        xtol=tolerance,
        ftol=tolerance,
        gtol=1e-15,
    )
    # the first two trials are both the start itself
    if len(tried) > 2 and not any(tried[2:]):
        return None
    return found.x, float(found.cost)
