"""Why each event of a result happened, in words and numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stickslip.model.arrays import Array, Indices
from stickslip.model.laws import Law
from stickslip.model.laws.base import Character
from stickslip.model.modes import Mode
from stickslip.results.outcome import Event, Outcome
from stickslip.results.samples import Samples
from stickslip.results.units import units

_VALUES_AT_ONCE = 1_000_000
_WORDS = {Mode.BACKWARD: "backward", Mode.STUCK: "nowhere", Mode.FORWARD: "forward"}


@dataclass(frozen=True)
class _BothSides:
    """Force, level and relative velocity of a row just before and after its event, and rows that changed with it."""

    force: tuple[float, float]
    level: tuple[float, float]
    w: tuple[float, float]
    others: list[str]


def event_sentences(result: Outcome) -> list[str]:
    """Return a heading and one line per event: time, contact, modes, cause."""
    events, samples = result.events, result.samples
    if not events:
        return ["Events: none"]
    scene = samples.system.scene
    names = {row.name: j for j, row in enumerate(samples.system.rows)}
    of_rows = [event for event in events if event.contact in names]
    elements = {row.name: row for row in scene.rows}
    changing = {event.contact: elements[event.contact] for event in of_rows}
    shared = units(scene, *changing.values())
    own = {name: units(scene, row) for name, row in changing.items()}
    lines = [f"Events: {len(events)} (forces in {shared.force}, velocities in {shared.velocity})"]
    noted = {name: f" [{unit.force}, {unit.velocity}]" for name, unit in own.items() if unit != shared}
    rows = [names[event.contact] for event in of_rows]
    dense = bool(of_rows) and samples.trajectory.is_dense
    around = dict(zip(map(id, of_rows), _both_sides(samples, of_rows, rows), strict=True)) if dense else {}
    for event in events:
        at = around.get(id(event))
        reason = event.cause if at is None else _reason(event, samples.system.rows[names[event.contact]].law, at)
        change = f"{event.before.name} -> {event.after.name}"
        lines.append(f"  {event.t:.12g} s  {event.contact} {change}: {reason}{noted.get(event.contact, '')}")
    return lines


def _both_sides(samples: Samples, events: list[Event], rows: list[int]) -> list[_BothSides]:
    """Return forces, levels and velocities at both sides of every event: at the end of a piece and the next start."""
    trajectory = samples.trajectory
    times = np.array([event.t for event in events])
    left = np.searchsorted(trajectory.stops, times, side="left")
    right = np.searchsorted(trajectory.starts, times, side="right") - 1
    at_once = _VALUES_AT_ONCE // max(samples.system.m, 1) + 1
    sides = []
    for piece_of in (left, right):
        read = []
        for first in range(0, times.size, at_once):
            some = slice(first, first + at_once)
            taus = trajectory.local(piece_of[some], times[some])
            at = Samples.at_local(trajectory, piece_of[some], taus)
            read.append(_at_events(at, np.array(rows[some])))
        sides.append(np.concatenate(read, axis=1).tolist())
    together: dict[float, set[str]] = {}
    for event in events:
        together.setdefault(event.t, set()).add(event.contact)
    found: list[_BothSides] = []
    for place, event in enumerate(events):
        force, level, w = ((sides[0][k][place], sides[1][k][place]) for k in range(3))
        found.append(_BothSides(force, level, w, sorted(together[event.t] - {event.contact})))
    return found


def _at_events(at: Samples, rows: Indices) -> Array:
    """Return force, level and relative velocity of one row at each time."""
    return np.array([table[rows, np.arange(rows.size)] for table in (at.forces, at.breakaways, at.relative_velocities)])


def _reason(event: Event, law: Law | None, at: _BothSides) -> str:
    character = Character() if law is None else law.character
    if character.has_slip_state and event.cause != "open":
        return _slip_state(event, character, at)
    if character.rests_below > 0 and event.cause == "relative velocity 0":
        return f"came into the dead band of {character.rests_below:g}; {_held(at)}"
    if event.cause in _AT_LIMITS:
        return _at_limit(event, at)
    if event.cause == "jump of velocities":
        jump = f"from {at.w[0]:.6g} to {at.w[1]:.6g}"
        return f"its relative velocity jumped {jump} with {_another(at, 'a drive')}"
    if event.cause == "force 0" and event.before != Mode.STUCK:
        return f"its force came to 0: {event.before.name.lower()} limit left"
    if law is None and event.before == Mode.STUCK:
        others = f" with {_another(at)}" if at.others else ""
        return f"its force came to 0{others}: runs free {_WORDS[event.after]}"
    return _friction(event, at)


_ROUGH = 1e-12  # a velocity after an impact below this part of the one before it is roundoff
_AT_LIMITS = ("touches", "leaves", "impact", "leaves with another event")


def _at_limit(event: Event, at: _BothSides) -> str:
    """Return in words what a gap or a stop did at a limit."""
    if event.cause == "impact":
        limit = "upper" if at.w[0] > 0 else "lower"
        if event.after != Mode.OPEN:
            ends = "closed"
        elif abs(at.w[1]) <= _ROUGH * abs(at.w[0]):
            ends = "and did not rebound"
        else:
            ends = f"rebounded with {at.w[1]:.6g}"
        return f"struck its {limit} limit at relative velocity {at.w[0]:.6g}, {ends}"
    if event.after == Mode.OPEN:
        limit = "upper" if event.before == Mode.FORWARD else "lower"
        others = f" with {_another(at)}" if "another" in event.cause and at.others else ""
        return f"left its {limit} limit{others} at relative velocity {at.w[1]:.6g}"
    limit = "upper" if event.after == Mode.FORWARD else "lower"
    return f"touched its {limit} limit at relative velocity {at.w[0]:.6g}"


def _another(at: _BothSides, otherwise: str = "") -> str:
    """Return in words which other rows changed at the same instant; `otherwise` where none did."""
    return f"the change of {', '.join(at.others)}" if at.others else otherwise


def _slip_state(event: Event, character: Character, at: _BothSides) -> str:
    drop = f"its force goes from {abs(at.force[0]):.6g} to {abs(at.force[1]):.6g}"
    if event.after == Mode.STUCK:
        return f"back in pre-slip at |w| = {abs(at.w[1]):.3g}, a tenth of the pre-slip velocity; {drop}"
    velocity = character.slips_beyond
    return f"slips {_WORDS[event.after]}: |w| exceeded the pre-slip velocity {velocity:g}; {drop}"


def _friction(event: Event, at: _BothSides) -> str:
    """Return in words what a contact with dry friction did."""
    where, force, level = _WORDS.get(event.after, ""), f"{abs(at.force[0]):.6g}", f"{at.level[0]:.6g}"
    slips = f"slips on with {abs(at.force[1]):.6g}"
    match event.cause:
        case "breakaway":
            return f"broke away {where}: needed {force} to stay stuck, could hold {level}; {slips}"
        case "breakaway with another event":
            why = _another(at, "a jump of the loads")
            return f"broke away {where} by {why}: needed {force} just before, could then hold {level}; {slips}"
        case "relative velocity 0":
            return f"its relative velocity reached 0; {_held(at)}"
        case "stuck with another event":
            return f"found at rest at {_another(at, 'a break of the loads')}; {_held(at)}"
        case "relaxation":
            left = f"velocities had become constant, {abs(at.w[0]):.3g} was left"
            return f"relaxed to rest: {left}; {_held(at)}"
        case "reversal":
            return f"passed 0 without sticking: that would have needed more than the {at.level[1]:.6g} it could hold"
        case "open":
            now = "is now 0" if event.after == Mode.STUCK else f"now points {where}"
            return f"carries no force; its relative velocity {now}"
    return event.cause


def _held(at: _BothSides) -> str:
    if math.isinf(at.level[1]):
        return f"its force is {abs(at.force[1]):.6g}"
    return f"needs {abs(at.force[1]):.6g} to stay stuck, can hold {at.level[1]:.6g}"
