"""Which signals are sums of others: drives with such velocities do not tear rows whose levers match the factors."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence

import numpy as np

from stickslip.model.signals import Constant, Function, PiecewiseLinear, Signal, Sine, Sum

_ROUGH = 1e-12  # part of the majorant of a sum below which it is roundoff
_MOST = 30  # signals that others are compared with, at the most
_Atoms = dict[Hashable, float]


def made_of_others(signals: Sequence[Signal]) -> list[dict[int, float]]:
    """Return for each signal the signals before it of which it is the sum, with their factors; or itself, with 1."""
    found: list[dict[int, float]] = []
    independent: dict[int, _Atoms] = {}
    with_atom: dict[Hashable, list[int]] = {}
    for k, signal in enumerate(signals):
        own = _atoms(signal, k)
        factors = _factors(own, {i: independent[i] for i in _joined(own, independent, with_atom)})
        if not factors:
            independent[k] = own
            for atom in own:
                with_atom.setdefault(atom, []).append(k)
        found.append(factors or {k: 1.0})
    return found


def _joined(own: _Atoms, independent: dict[int, _Atoms], with_atom: dict[Hashable, list[int]]) -> list[int]:
    """Return the signals that share atoms with one, or with others that do; one more than `_MOST` at the most."""
    found, seen, open_ones = dict[int, None](), set(own), list(own)
    while open_ones:
        for i in with_atom.get(open_ones.pop(), ()):
            if len(found) > _MOST:
                return list(found)
            if i not in found:
                found[i] = None
                open_ones += [atom for atom in independent[i] if atom not in seen]
                seen.update(independent[i])
    return list(found)


def _factors(own: _Atoms, others: dict[int, _Atoms]) -> dict[int, float]:
    """Return the factors with which other signals add up to one, none if they do not."""
    if not 0 < len(others) <= _MOST:
        return {}
    atoms = list(dict.fromkeys([*own, *(atom for one in others.values() for atom in one)]))
    sizes = np.array([[one.get(atom, 0.0) for atom in atoms] for one in others.values()])
    wanted = np.array([own.get(atom, 0.0) for atom in atoms])
    scale = np.abs(sizes).max(axis=1)
    factors = np.linalg.lstsq((sizes / scale[:, None]).T, wanted, rcond=_ROUGH)[0]
    left = np.abs(factors @ (sizes / scale[:, None]) - wanted)
    if left.max() > _ROUGH * np.abs(wanted).max():
        return {}
    some = np.abs(factors) > _ROUGH * np.abs(factors).max()
    return {k: float(c / s) for k, c, s, has in zip(others, factors, scale, some, strict=True) if has}


def _atoms(signal: Signal, number: int) -> _Atoms:
    """Return the atoms of which a signal is the sum, with their factors, but for roundoff; a constant is its own."""
    found: _Atoms = {}
    try:
        for atom, factor in _parts(signal):
            found[atom] = found.get(atom, 0.0) + factor
    except TypeError:
        # a function that has no hash
        found = {number: 1.0}
    largest = max(map(abs, found.values()), default=0.0)
    some = {atom: factor for atom, factor in found.items() if abs(factor) > _ROUGH * largest}
    # a drive of constant velocity has no acceleration that could tear rows
    return {number: 1.0} if some.keys() <= {"one"} else some


def _parts(signal: Signal) -> Iterator[tuple[Hashable, float]]:
    match signal:
        case Sum(terms):
            for term in terms:
                yield from _parts(term)
        case Constant(value):
            yield "one", value
        case Sine(amplitude, frequency, phase, offset):
            yield ("sine", frequency), amplitude * math.cos(phase)
            yield ("cosine", frequency), amplitude * math.sin(phase)
            yield "one", offset
        case PiecewiseLinear(times, values):
            yield "one", values[0]
            steps, rises = np.diff(times), np.diff(values)
            slopes = np.divide(rises, steps, out=np.zeros(steps.size), where=steps > 0)
            for t, jump in zip(times, rises * (steps == 0), strict=False):
                yield ("jump", t), float(jump)
            for t, bend in zip(times, np.diff(slopes, prepend=0.0, append=0.0).tolist(), strict=True):
                yield ("bend", t), bend
        case Function(function=function, factor=factor):
            yield ("function", function, signal.break_times, signal.limits), factor
        case _:
            yield signal, 1.0
