"""Contact modes, named after the sign of the relative velocity."""

from enum import IntEnum


class Mode(IntEnum):
    """Mode of a contact: the sign of its relative velocity ``w = v_a - v_b``."""

    BACKWARD = -1
    STUCK = 0
    FORWARD = 1
