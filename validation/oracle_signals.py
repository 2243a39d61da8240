"""Loads of the oracle: value and slope just after a time, and the times at which they jump or bend."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

Point = tuple[float, float]


def just_after(t: float) -> float:
    """Return the time from which breaks lie ahead: those within roundoff of `t` have passed."""
    return t + 4e-15 * max(1.0, abs(t))


@dataclass(frozen=True)
class Lines:
    """Straight lines between points, constant before the first and after the last; a time given twice is a jump."""

    points: tuple[Point, ...]

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which the value or the slope jumps."""
        return tuple(t for t, _ in self.points) if len(self.points) > 1 else ()

    @property
    def size(self) -> float:
        """The largest magnitude."""
        return max(abs(value) for _, value in self.points)

    def after(self, start: float, tau: float) -> Point:
        """Return value and slope at start + tau on the line that begins at or before `start`."""
        place = bisect_right(self.points, just_after(start), key=lambda point: point[0])
        if place == 0:
            return self.points[0][1], 0.0
        t, value = self.points[place - 1]
        if place == len(self.points):
            return value, 0.0
        later, following = self.points[place]
        slope = (following - value) / (later - t)
        return value + slope * (start - t) + slope * tau, slope

    def pressed(self) -> Lines:
        """Return the normal force: 0 where this is negative, with its zeros among the points."""
        points = [self.points[0]]
        for (t, value), (later, following) in pairwise(self.points):
            if value * following < 0 and later > t:
                points.append((t + (later - t) * -value / (following - value), 0.0))
            points.append((later, following))
        return Lines(tuple((t, max(value, 0.0)) for t, value in points))


@dataclass(frozen=True)
class Sine:
    """offset + amplitude sin(2 pi frequency t + phase), times in s and the frequency in Hz; never negative as N."""

    amplitude: float
    frequency: float
    phase: float = 0.0
    offset: float = 0.0
    breaks: tuple[float, ...] = ()

    @property
    def size(self) -> float:
        """The largest magnitude."""
        return abs(self.offset) + abs(self.amplitude)

    def after(self, start: float, tau: float) -> Point:
        """Return value and slope at start + tau."""
        omega = 2 * math.pi * self.frequency
        angle = omega * (start + tau) + self.phase
        return self.offset + self.amplitude * math.sin(angle), self.amplitude * omega * math.cos(angle)

    def pressed(self) -> Sine:
        """Return the normal force, which is this one."""
        if self.offset < abs(self.amplitude):
            raise ValueError("a normal force that is a sine must not become negative")
        return self


def read(data: Any) -> Lines | Sine:
    """Return a load from plain data: a number, a list of [t, value], or the parameters of a sine by name."""
    if isinstance(data, Mapping):
        return Sine(**data)
    if isinstance(data, (int, float)):
        return Lines(((0.0, float(data)),))
    return Lines(tuple((float(t), float(value)) for t, value in data))
