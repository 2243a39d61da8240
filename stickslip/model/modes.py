"""Modes of contacts and other rows, named after the sign of the relative velocity."""

from enum import IntEnum


class Mode(IntEnum):
    """Mode of a contact: the sign of its relative velocity ``w = radius_a v_a - radius_b v_b``.

    A gap or a stop is OPEN between its limits, FORWARD at the upper one, BACKWARD at the lower one.
    """

    BACKWARD = -1
    STUCK = 0
    FORWARD = 1
    OPEN = 2
