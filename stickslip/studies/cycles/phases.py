"""The changes of modes of limit cycles: which phases are the same, which come and go, and which are about to vanish."""

from __future__ import annotations

from collections import Counter

import numpy as np

from stickslip.studies.cycles.cycle import Cycle

_SHORT = 0.02  # a phase shorter than this part of the period is about to vanish

# A relative velocity grazes 0 if its slope there would change it in a period by less than _GRAZING_CHANGE of its range.
# The slope is that over the last _BEFORE of a period, or over the last _LATEST of the motion before if that is less.
_BEFORE, _LATEST, _GRAZING_CHANGE = 1e-4, 1e-2, 0.3


def alike(a: Cycle, b: Cycle) -> bool:
    """Tell whether two cycles have the same changes of modes, wherever their periods begin."""
    one, other = a.sequence, b.sequence
    rotations = (other[k:] + other[:k] for k in range(max(len(other), 1)))
    return one in rotations


def in_words(a: Cycle, b: Cycle) -> str:
    """Return in words how the sequence of one cycle becomes that of another."""
    new, old = Counter(b.sequence) - Counter(a.sequence), Counter(a.sequence) - Counter(b.sequence)
    parts = []
    for found, others, word in ((new, old, "begins"), (old, new, "ceases")):
        names, too = ({one.split(":")[0] for one in some} for some in (found, others))
        for name in sorted(names):
            if name not in too:
                own = " ".join(one for one in found if one.startswith(f"{name}:"))
                if "OPEN" in own:
                    does = "be met (its stretch only just comes to a limit)"
                else:
                    does = f"{'stick' if 'STUCK' in own else 'reverse'} (its relative velocity grazes 0)"
                parts.append(f"{name!r} {word} to {does}")
            elif found is new:
                parts.append(f"{name!r} changes its order of sticking, reversing and slipping")
    return "; ".join(parts) or "the same changes of modes come in another order"


def vanishing(cycle: Cycle) -> list[str]:
    """Return in words which phases of a cycle are about to vanish, and which relative velocities only just reach 0."""
    found = []
    events, said, period = cycle.result.events, cycle.sequence, cycle.period
    begins = cycle.result.t[0]
    for k, event in enumerate(events):
        later = (k + 1) % len(events)
        if len(events) > 1 and (events[later].t - event.t) % period < _SHORT * period:
            found.append(f"the phase between '{said[k]}' and '{said[later]}' vanishes")
        if event.cause == "impact":
            speed = np.abs(cycle.result.sample([event.t]).relative_velocity(event.contact)[0])
            if speed < _SHORT * np.ptp(cycle.result.relative_velocity(event.contact)):
                found.append(f"the impact at {event.contact!r} comes to graze")
        elif event.cause == "relative velocity 0" or event.before * event.after < 0:
            before = max((other.t for other in events if other.t < event.t), default=begins)
            short = min(_BEFORE * period, _LATEST * (event.t - before))
            speed = np.abs(cycle.result.sample([event.t - short]).relative_velocity(event.contact)[0])
            if speed * period < _GRAZING_CHANGE * short * np.ptp(cycle.result.relative_velocity(event.contact)):
                found.append(f"the relative velocity of {event.contact!r} comes to graze 0 at '{said[k]}'")
    return found
