"""Each event of a result as a sentence with the numbers that caused it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip.laws import Law
from stickslip.modes import Mode
from stickslip.regularized import Karnopp, PreSlip
from stickslip.result import Event, Result
from stickslip.sampling import is_dense, sampled

__all__ = ["event_sentences"]

Array = NDArray[np.float64]

_ROUNDOFF = 1e-14
_WORDS = {Mode.BACKWARD: "backward", Mode.STUCK: "nowhere", Mode.FORWARD: "forward"}


@dataclass(frozen=True)
class _Limits:
    """Force, breakaway level and relative velocity of a contact just before and just after its event."""

    force: tuple[float, float]
    level: tuple[float, float]
    w: tuple[float, float]
    others: list[str]


def event_sentences(result: Result) -> list[str]:
    """Return a heading and one line per event: time, contact, modes, cause.

    Parameters
    ----------
    result : Result
        One without what interpolation needs gets causes without numbers.
    """
    if not result.events:
        return ["Events: none"]
    lines = [f"Events: {len(result.events)} (forces in N | N m, velocities in m/s | rad/s)"]
    limits: Sequence[_Limits | None] = [None] * len(result.events)
    if is_dense(result):
        limits = _limits(result)
    for event, around in zip(result.events, limits, strict=True):
        law = result.scene.contacts[result._contact(event.contact)].law
        reason = event.cause if around is None else _reason(event, law, around)
        change = f"{event.before.name} -> {event.after.name}"
        lines.append(f"  {event.t:.12g} s  {event.contact} {change}: {reason}")
    return lines


def _limits(result: Result) -> list[_Limits]:
    """Read forces and levels at both sides of every event: the end of one piece, the start of the next."""
    pieces, events = result._pieces, result.events
    starts, stops = np.array([p.start for p in pieces]), np.array([p.stop for p in pieces])
    left = np.searchsorted(stops, [e.t for e in events], side="left")
    right = np.searchsorted(starts, [e.t for e in events], side="right") - 1
    sides = []
    for chosen, at_end in ((left, True), (right, False)):
        taus = [np.array([pieces[k].taus[-1] if at_end else 0.0]) for k in chosen.tolist()]
        for place, (event, k) in enumerate(zip(events, chosen.tolist(), strict=True)):
            if left[place] == right[place]:  # an open contact turns over within a piece
                taus[place] = np.array([event.t - pieces[k].start])
        sides.append(sampled(result, chosen.tolist(), taus))
    pairs = [
        _pairs(read, sides, events) for read in (Result.force, Result.breakaway, Result.relative_velocity)
    ]
    together: dict[float, set[str]] = {}
    for event in events:
        together.setdefault(event.t, set()).add(event.contact)
    return [
        _Limits(force, level, w, sorted(together[event.t] - {event.contact}))
        for event, force, level, w in zip(events, *pairs, strict=True)
    ]


def _pairs(
    read: Callable[[Result, str], Array], sides: Sequence[Result], events: Sequence[Event]
) -> list[tuple[float, float]]:
    """Return a quantity of each event's contact just before and just after it; each contact is read once."""
    places: dict[str, list[int]] = {}
    for place, event in enumerate(events):
        places.setdefault(event.contact, []).append(place)
    found = np.empty((len(events), 2))
    for contact, chosen in places.items():
        for side, result in enumerate(sides):
            found[chosen, side] = read(result, contact)[chosen]
    return [(before, after) for before, after in found.tolist()]


def _reason(event: Event, law: Law, limits: _Limits) -> str:
    if isinstance(law, PreSlip) and event.cause != "open":
        return _slip_state(event, law, limits)
    if isinstance(law, Karnopp) and event.cause == "relative velocity 0":
        return f"came into the dead band of {law.velocity:g}; {_held(limits)}"
    sentence = _SENTENCES.get(event.cause)
    return event.cause if sentence is None else sentence(event, limits)


def _slip_state(event: Event, law: PreSlip, at: _Limits) -> str:
    drop = f"its force goes from {abs(at.force[0]):.6g} to {abs(at.force[1]):.6g}"
    if event.after == Mode.STUCK:
        return f"back in pre-slip at |w| = {abs(at.w[1]):.3g}, a tenth of the pre-slip velocity; {drop}"
    return f"slips {_WORDS[event.after]}: |w| exceeded the pre-slip velocity {law.velocity:g}; {drop}"


def _broke_away(event: Event, at: _Limits) -> str:
    needed = f"needed {abs(at.force[0]):.6g} to stay stuck, could hold {at.level[0]:.6g}"
    return f"broke away {_WORDS[event.after]}: {needed}; slips on with {abs(at.force[1]):.6g}"


def _broke_away_with(event: Event, at: _Limits) -> str:
    reason = f"the change of {', '.join(at.others)}" if at.others else "a jump of the loads"
    needed = f"needed {abs(at.force[0]):.6g} just before, could then hold {at.level[0]:.6g}"
    return f"broke away {_WORDS[event.after]} by {reason}: {needed}; slips on with {abs(at.force[1]):.6g}"


def _held(at: _Limits) -> str:
    needed, level = abs(at.force[1]), at.level[1]
    if needed < _ROUNDOFF * level:
        needed = 0.0
    return f"needs {needed:.6g} to stay stuck, can hold {level:.6g}"


def _stuck(event: Event, at: _Limits) -> str:
    return f"its relative velocity reached 0; {_held(at)}"


def _stuck_with(event: Event, at: _Limits) -> str:
    reason = f"the change of {', '.join(at.others)}" if at.others else "a break of the loads"
    return f"found at rest at {reason}; {_held(at)}"


def _relaxed(event: Event, at: _Limits) -> str:
    return f"relaxed to rest: velocities had become constant, {abs(at.w[0]):.3g} was left; {_held(at)}"


def _reversed(event: Event, at: _Limits) -> str:
    return f"passed 0 without sticking: that would have needed more than the {at.level[1]:.6g} it could hold"


def _open(event: Event, at: _Limits) -> str:
    now = "is now 0" if event.after == Mode.STUCK else f"now points {_WORDS[event.after]}"
    return f"carries no force; its relative velocity {now}"


_SENTENCES: dict[str, Callable[[Event, _Limits], str]] = {
    "breakaway": _broke_away,
    "breakaway with another event": _broke_away_with,
    "relative velocity 0": _stuck,
    "stuck with another event": _stuck_with,
    "relaxation": _relaxed,
    "reversal": _reversed,
    "open": _open,
}
