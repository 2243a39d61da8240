"""What a scene is compiled to and why, and what was watched while it ran, in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.loads.loads import Loads
from stickslip.equations.mode_equations import APART, AT_HIGH, AT_LOW, FREE, OPEN
from stickslip.equations.system import System
from stickslip.model.arrays import Modes
from stickslip.model.elements import KINDS, AnyBlock, Contact, Gap, OneWay, Sampled, StateSpace, Stop
from stickslip.model.modes import Mode
from stickslip.model.quantities import Feedback, Output, Power, Quantity, Table, as_expression
from stickslip.model.scene import Scene
from stickslip.model.signals import Constant, as_signal
from stickslip.results.causes import event_sentences
from stickslip.results.in_a_row import BETWEEN
from stickslip.results.outcome import Outcome
from stickslip.results.readable import Readable
from stickslip.results.units import units

_LISTED = 12
_MODE_SETS = 20
_DENSE = 500
_WHERE_OPEN = "where it is 0 the contact is open, and only its direction is watched"


def explain_scene(system: System, loads: Loads, engine: str, reason: str) -> str:
    """Return what a scene is compiled to, and which engine takes it."""
    return "\n".join([*_compiled(system, loads), f"Engine: {engine}, because {reason}"])


def explain_result(result: Readable) -> str:
    """Return what was compiled, which guards were watched, and why each event happened, run by run.

    A result that kept only its outputs gets causes without numbers.
    """
    parts = []
    for run in result.runs:
        trajectory = run.samples.trajectory
        lines = [*_compiled(trajectory.system, trajectory.loads), *_watched(run), *event_sentences(run)]
        if len(result.runs) > 1:
            start = float(trajectory.starts[0])
            between = [f"  {event}" for event in result.events if event.t == start and event.cause == BETWEEN]
            title = f"From {start:g} s to {trajectory.stops[-1]:g} s"
            lines = [title, *(["Changes from the run before:", *between] if between else []), *lines]
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def span_of(scene: Scene) -> tuple[float, float]:
    """Return a time span in s from 0 to past the last break of a load."""
    signals = [as_expression(c.normal).signal for c in scene.contacts]
    signals += [as_expression(f.signal).signal for f in scene.forces]
    signals += [as_signal(d.velocity, d.label) for d in scene.drives]
    last = max((t for s in signals for t in s.breaks(0.0, math.inf)), default=0.0)
    return 0.0, last * 1.01 if last > 0 else 1.0


# -- the scene --------------------------------------------------------------------------------------------


def _compiled(system: System, loads: Loads) -> list[str]:
    scene = system.scene
    kinds = ((kind.noun(), len(getattr(scene, table))) for table, kind in KINDS.items())
    present = ", ".join(_count(number, name) for name, number in kinds if number)
    lines = [
        f"Scene: {present}",
        *_states(system),
        *_contacts(system),
        *_others(system),
        *_loads(system, loads),
        *_feedback(system),
    ]
    kind = "sparse" if system.sparse else "dense"
    lines.append(f"Matrices: {kind} (bodies and contacts together: {system.n + system.m})")
    return lines


def _states(system: System) -> list[str]:
    moving = [*system.scene.bodies, *system.scene.drives]
    placed = [moving[i].name for i in system.placed]
    bristles = [system.scene.contacts[j].name for j in system.bristle_state]
    lines = [f"States: {system.size}", f"  {_count(system.n, 'velocity')}: {_listed(system.names)}"]
    if placed:
        why = "where springs act or quantities read them" if _fed_back(system.scene) else "where springs act"
        lines.append(f"  {_count(len(placed), 'position')}, {why}: {_listed(placed)}")
    else:
        lines.append("  no positions: no spring acts")
    if bristles:
        lines.append(f"  {_count(len(bristles), 'bristle deflection')}: {_listed(bristles)}")
    if of_blocks := [f"{name} ({place.end - place.first})" for name, place in system.blocks.items()]:
        count = system.size - system.first_block
        held = ", held outputs among them" if system.sampled else ""
        lines.append(f"  {_count(count, 'state')} of blocks{held}: {_listed(of_blocks)}")
    return lines


def _contacts(system: System) -> list[str]:
    contacts = system.scene.contacts
    if not contacts:
        return [] if system.m else ["Contacts: none, so no modes and no guards"]
    # contacts are the first rows
    alive = np.flatnonzero(system.alive[: len(contacts)]).tolist()
    lines = [f"Contacts: {len(alive)} of {len(contacts)} assembled"]
    lines += [f"  {contacts[j].name}: {_contact(system, j)}" for j in alive[:_LISTED]]
    lines += _left_out(len(alive))
    frictionless = [c.name for j, c in enumerate(contacts) if system.mu_s[:, j].max() == 0]
    unloaded = [c.name for j, c in enumerate(contacts) if not (system.loaded[j] or c.name in frictionless)]
    for names, reason in ((frictionless, "frictionless"), (unloaded, "never loaded")):
        if names:
            lines.append(f"  left out, {reason}: {_listed(names)}")
    return lines


def _others(system: System) -> list[str]:
    """Return lines on rows that are no contacts: their equations and guards."""
    rows = [element for element in system.scene.rows if not isinstance(element, Contact)]
    if not rows:
        return []
    limits = system.scene.gaps or system.scene.stops
    kinds = "Ties, one-way clutches, gaps and stops" if limits else "Ties and one-way clutches"
    lines = [f"{kinds}: {len(rows)}"]
    for element in rows[:_LISTED]:
        w = _sum(element.coefficients)
        if isinstance(element, OneWay):
            lines.append(f"  {element.name}: {w} <= 0; guards: 1 overrunning (w), 1 locked (its force)")
        elif isinstance(element, Gap):
            lines.append(f"  {element.name}: {_gap(element)}")
        elif isinstance(element, Stop):
            ends = _limits_of(element)
            lines.append(
                f"  {element.name}: stretch {w}; rigid at {ends}, restitution {element.restitution:g}; "
                "guards: open (its stretch at each limit), 1 closed (its force)"
            )
        else:
            lines.append(f"  {element.name}: {w} = 0 for ever; no guard")
    lines += _left_out(len(rows))
    weightless = [body.name for body in system.scene.bodies if body.inertia == 0]
    if weightless:
        lines.append(f"  without inertia, moved by ties alone: {_listed(weightless)}")
    if still := _held_still(system):
        lines.append(f"  locked, because ties leave no motion but rest: {_listed(still)}")
    return lines


def _held_still(system: System) -> list[str]:
    """Return the bodies that ties alone hold still for ever, such as those of gears in a loop that do not fit."""
    if not system.is_tie.any() or system.n > _DENSE:
        return []
    rows = np.hstack([dense(one)[system.is_tie] for one in (system.G, system.D)])
    motions = scipy.linalg.null_space(rows / np.abs(rows).max(axis=1, keepdims=True))
    moves = np.abs(motions).max(axis=1, initial=0.0)
    return [name for name, how_far in zip(system.names, moves.tolist(), strict=False) if how_far < 1e-9]


def _gap(gap: Gap) -> str:
    """Return the limits of a gap, its law and its guards."""
    law = f"elastic beyond {_limits_of(gap)}, stiffness {gap.stiffness:g}"
    if gap.damping:
        law += f", damping {gap.damping:g}"
    clip = ", closed (its stretch, and where the clip of its damping turns)" if gap.damping else ", 1 closed"
    return f"stretch {_sum(gap.coefficients)}; {law}; guards: open (its stretch at each limit){clip}"


def _limits_of(row: Gap | Stop) -> str:
    return " and ".join(f"{limit:g}" for limit in (row.lower, row.upper) if math.isfinite(limit))


def _sum(coefficients: Mapping[str, float]) -> str:
    """Return a sum of multiples of velocities as it is written."""
    parts = [f"{'-' if c < 0 else '+'} {abs(c):g} {name}" for name, c in coefficients.items()]
    return " ".join(parts).removeprefix("+ ")


def _contact(system: System, j: int) -> str:
    contact = system.scene.contacts[j]
    law = _law(contact, units(system.scene, contact).velocity)
    return f"{contact.a} on {contact.b}, {law}; {_guards(system, j)}; {_normal(contact)}"


def _law(contact: Contact, unit: str) -> str:
    law = contact.law
    core, character = law.core, law.character
    text = f"{type(law).__name__}, static {core.mu_static:g}, Coulomb {core.mu_coulomb:g}"
    if core.dwell:
        text += f", dwell {core.dwell:g} s"
        if core.stribeck_velocity is not None:
            text += " (without effect beside a Stribeck curve)"
    if core.curved:
        text += ", kinetic curve"
    if width := max(character.slips_beyond, character.rests_below):
        text += f", within {width:g} {unit}"
    return text


def _guards(system: System, j: int) -> str:
    if system.free[j]:
        return "no mode and no guard: its law is smooth"
    if system.hard[j]:
        rises = system.dwell[j] > 0 and system.laws.laws[j].core.stribeck_velocity is None
        rise = ", with the dwell's rise" if rises else ""
        return f"guards: 1 slipping (w), 2 stuck (B - r and B + r{rise})"
    return "guards: 1 slipping (|w| falls to 0.1 of the pre-slip velocity), 2 in pre-slip (|w| exceeds it)"


def _normal(contact: Contact) -> str:
    if isinstance(contact.normal, Quantity):
        return "normal force that depends on the state; a guard tells where it comes to 0"
    signal = as_expression(contact.normal).signal
    if isinstance(signal, Constant):
        return f"normal force {signal.value:g} N"
    if signal.period is None:
        return f"normal force piecewise linear; {_WHERE_OPEN}"
    return f"normal force curved; {_WHERE_OPEN}"


def _loads(system: System, loads: Loads) -> list[str]:
    times = [f"{t:g}" for t in loads.breaks if not loads.is_only_sample(t)]
    lines = ["Loads: no breaks"]
    if times:
        lines = [f"Loads: {_count(len(times), 'break')}, stop times and not guards: {_listed(times)} s"]
    curved = sum(signal.period is not None for signal in (*system.normals, *system.others))
    if curved:
        period = f", shortest period {loads.period:g} s" if math.isfinite(loads.period) else ""
        lines.append(f"  {_count(curved, 'load entry')} not piecewise linear{period}")
    elif times:
        lines.append("  piecewise linear: rates, forces and guards are affine between stops")
    return lines


def _fed_back(scene: Scene) -> list[tuple[str, Quantity]]:
    """Return the forces and normal forces that depend on the state, with their labels."""
    found = [(f.label, f.signal) for f in scene.forces]
    found += [(f"normal force of {c.name!r}", c.normal) for c in scene.contacts]
    return [(label, load) for label, load in found if isinstance(load, Quantity)]


def _feedback(system: System) -> list[str]:
    """Return how forces, normal forces and blocks depend on the state: linearly, or how else."""
    lines = [f"  {label}: {_form(load)}" for label, load in _fed_back(system.scene)]
    lines += [f"  {place.block.label}: {_block(place.block)}" for place in system.blocks.values()]
    if not lines:
        return []
    return ["Feedback:", *lines[:_LISTED], *_left_out(len(lines))]


def _form(load: Quantity) -> str:
    """Return how a quantity depends on the state."""
    parts = list(load.walk())
    corners = sum(len(part.xs) for part in parts if isinstance(part, Table))
    functions = [part.label for part in parts if isinstance(part, Feedback)]
    functions += [f"the power of {part.row!r}" for part in parts if isinstance(part, Power)]
    blocks = sorted({part.block for part in parts if isinstance(part, Output)})
    told = "straight lines, " + _count(corners, "corner") if corners else "linear in the state"
    if functions:
        told = f"smooth, by {_listed(functions)}" + (f"; {_count(corners, 'corner')}" if corners else "")
    return told + (f"; reads {_listed(blocks)}" if blocks else "")


def _block(block: AnyBlock) -> str:
    """Return the kind of a block in words."""
    if isinstance(block, Sampled):
        return f"sampled every {block.period:g} s, held between"
    if isinstance(block, StateSpace):
        return "linear" + (", its output limited" if block.limits is not None else "")
    return "smooth functions"


# -- the result -------------------------------------------------------------------------------------------


def _watched(result: Outcome) -> list[str]:
    """Return which guards were watched in which sets of modes, and for how long."""
    seen: dict[bytes, tuple[Modes, list[float]]] = {}
    trajectory = result.samples.trajectory
    for modes, duration in trajectory.each_modes():
        seen.setdefault(modes.tobytes(), (modes, []))[1].append(duration)
    ends = {0: "reached the end", 1: result.message}
    outcome = ends.get(result.status, f"stopped early ({result.message})")
    lines = [f"Simulation: {outcome}; " + ", ".join(f"{k} {v}" for k, v in result.stats.items())]
    if result.stats.get("engine") == "Taylor series":
        lines.append(
            f"No event can have been missed: of the guards looked at, {result.stats['guards_excluded']} were proved "
            f"to have no root, and the first roots of {result.stats['guards_isolated']} were isolated; a guard that "
            "passes 0 by less than 2e-15 of its terms does not count"
        )
    lines.append(f"Sets of modes met: {len(seen)}")
    for modes, times in list(seen.values())[:_MODE_SETS]:
        together = f"{sum(times):.4g} s in {_count(len(times), 'piece')}"
        lines.append(f"  {together}: {_modes(trajectory.system, modes)}")
    return lines + _left_out(len(seen), _MODE_SETS)


def _modes(system: System, modes: Modes) -> str:
    words = {
        Mode.STUCK: "stuck",
        Mode.FORWARD: "forward",
        Mode.BACKWARD: "backward",
        OPEN: "open",
        FREE: "smooth",
        AT_HIGH: "stuck",
        AT_LOW: "stuck",
        APART: "apart",
    }
    names: dict[str, list[str]] = {word: [] for word in words.values()}
    for row, mode, alive in zip(system.rows, modes.tolist(), system.alive, strict=True):
        if alive:
            names[words[mode]].append(row.name)
    guards = len(names["forward"]) + len(names["backward"])
    rests = np.isin(modes, (0, AT_HIGH, AT_LOW)) & system.alive
    guards += 2 * int((rests & system.is_friction).sum()) + int((rests & system.is_one_way).sum())
    return "; ".join([_count(guards, "guard"), *(f"{word} {_listed(of)}" for word, of in names.items() if of)])


def _count(number: int, name: str) -> str:
    if number == 1:
        return f"1 {name}"
    plural = name[:-1] + "ies" if name[-1] == "y" else name + ("es" if name.endswith("ch") else "s")
    return f"{number} {plural}"


def _left_out(count: int, most: int = _LISTED) -> list[str]:
    """Return the last line of a list that shows only the first `most` of `count` entries; none if it shows all."""
    return [f"  ... and {count - most} more"] if count > most else []


def _listed(names: Iterable[str]) -> str:
    all_names = list(names)
    rest = len(all_names) - _LISTED
    return ", ".join(all_names[:_LISTED]) + (f", ... ({rest} more)" if rest > 0 else "")
