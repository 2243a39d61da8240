"""Ready-made controllers, built from blocks."""

from __future__ import annotations

import math
from dataclasses import dataclass

from stickslip.model.arrays import Array
from stickslip.model.checks import finite, limit
from stickslip.model.elements.block import Sampled, StateSpace
from stickslip.model.quantities import as_expression, output
from stickslip.model.signals import Load


def pid(
    name: str,
    error: Load | float,
    *,
    kp: float,
    ki: float = 0.0,
    kd: float = 0.0,
    rate: Load | float | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    period: float | None = None,
) -> StateSpace | Sampled:
    """Return a PID controller as a block: ``output(name) = kp e + ki integral of e dt + kd e'``.

    Without `period` it is continuous, linear between its limits and exact in the series engine. With `period` it is
    sampled and holds its output between samples. With limits it does not wind up: the continuous one has
    ``integral' = e + (output - output without limits) / kp``, and so needs `kp`; the sampled one stops integrating
    while its output is beyond a limit and the error would drive it further.

    Parameters
    ----------
    name : str
        Of the block.
    error : Quantity, Signal or float
        e, such as ``target - position("m")``.
    kp, ki, kd : float
        Gains.
    rate : Quantity, optional
        e', such as ``-1 * velocity("m")``; a continuous controller with `kd` needs it, a sampled one takes differences
        of its samples without it.
    low, high : float
        Limits of the output. A continuous controller with limits has a second output: the output without limits.
    period : float, optional
        Of the samples, in s.

    Raises
    ------
    TypeError, ValueError
        If an argument is no number or quantity, or the rate or a gain is missing that is needed.
    """
    label = f"pid {name!r}"
    kp, ki, kd = (finite(value, f"{label}: {gain}") for gain, value in (("kp", kp), ("ki", ki), ("kd", kd)))
    low, high = limit(low, -math.inf, f"{label}: limits"), limit(high, math.inf, f"{label}: limits")
    if not low < high:
        raise ValueError(f"{label}: low must be below high, got {low:g} and {high:g}; exchange them")
    e = as_expression(error, f"{label}: error")
    if period is not None:
        inputs = [e] if rate is None else [e, as_expression(rate, f"{label}: rate")]
        differs = kd != 0 and rate is None
        law = _Law(kp, ki, kd, low, high, finite(period, f"{label}: period"), differs)
        # states: the integral; where differences are taken, also the error of the last sample, and 1 if there was one
        return Sampled(
            name,
            period=period,
            inputs=tuple(inputs),
            states=(0.0, 0.0, 0.0) if differs else (0.0,),
            update=law.update,
            output=law.output,
            outputs=1,
        )
    if kd and rate is None:
        raise ValueError(
            f"{label}: kd needs rate=, the derivative of the error as a quantity, such as -1 * velocity('m'); "
            "only a sampled controller (period=...) takes differences"
        )
    de = as_expression(0.0 if rate is None else rate, f"{label}: rate")
    if math.isinf(low) and math.isinf(high):
        return StateSpace(name, 0.0, [[1.0, 0.0]], ki, [[kp, kd]], inputs=(e, de))
    if ki and not kp:
        raise ValueError(f"{label}: limits with ki need kp, by which what is cut off is led back")
    back = 1.0 / kp if kp else 0.0
    cut = output(name, 0) - output(name, 1)
    rows = [[kp, kd, 0.0]] * 2
    both = ((low, high), (-math.inf, math.inf))
    return StateSpace(name, 0.0, [[1.0, 0.0, back]], [[ki]] * 2, rows, inputs=(e, de, cut), limits=both)


@dataclass(frozen=True)
class _Law:
    """The functions of a sampled controller."""

    kp: float
    ki: float
    kd: float
    low: float
    high: float
    period: float
    differences: bool

    def _raw(self, x: Array, u: Array) -> float:
        found = self.kp * u[0] + self.ki * x[0]
        if self.differences:
            found += self.kd * x[2] * (u[0] - x[1]) / self.period
        elif self.kd:
            found += self.kd * u[1]
        return float(found)

    def output(self, t: float, x: Array, u: Array) -> float:
        """Return the limited output."""
        return min(max(self._raw(x, u), self.low), self.high)

    def update(self, t: float, x: Array, u: Array) -> list[float]:
        """Return the next states; where the output is beyond a limit, the integral does not drive it further."""
        raw, push = self._raw(x, u), self.ki * u[0]
        beyond = (raw > self.high and push > 0) or (raw < self.low and push < 0)
        integral = float(x[0] + (0.0 if beyond else self.period * u[0]))
        return [integral, float(u[0]), 1.0] if self.differences else [integral]
