"""What a scene is assembled to and why, and why each event of a result happened, in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.explain_events import event_sentences
from stickslip.laws import DryFriction
from stickslip.mode_set import FREE, OPEN
from stickslip.modes import Mode
from stickslip.result import Result
from stickslip.scene import Contact, Scene
from stickslip.signals import Constant, as_signal

__all__ = ["explain"]

_LISTED = 12
_MODE_SETS = 20


def explain(subject: Scene | Result, t_span: Sequence[float] | None = None) -> str:
    """Return what is assembled and why; for a result also what was watched and why each event happened.

    Parameters
    ----------
    subject : Scene or Result
    t_span : (float, float), optional
        Time span in s for the stop times of a scene; by default from 0 to past the last break of a load.

    Raises
    ------
    TypeError
        If `subject` is neither a scene nor a result.
    ValueError
        If a result is given together with a time span, or the span does not run forward.
    """
    if isinstance(subject, Result):
        if t_span is not None:
            raise ValueError("explain: a result has a time span of its own; leave t_span out")
        return "\n".join([*_assembled(subject._system), *_watched(subject), *event_sentences(subject)])
    if not isinstance(subject, Scene):
        raise TypeError(f"explain: expected a Scene or a Result, got {type(subject).__name__}")
    start, stop = _span(subject) if t_span is None else (float(t_span[0]), float(t_span[1]))
    if not start < stop:
        raise ValueError(f"explain: t_span must run forward, got ({start:g}, {stop:g}); swap the two times")
    return "\n".join(_assembled(System(subject).over(start, stop)))


def _span(scene: Scene) -> tuple[float, float]:
    signals = [as_signal(c.normal, c.label) for c in scene.contacts]
    signals += [as_signal(f.signal, f.label) for f in scene.forces]
    signals += [as_signal(d.velocity, d.label) for d in scene.drives]
    last = max((t for s in signals for t in s.breaks(0.0, math.inf)), default=0.0)
    return 0.0, last * 1.01 if last > 0 else 1.0


# -- the scene --------------------------------------------------------------------------------------------


def _assembled(system: System) -> list[str]:
    scene = system.scene
    kinds = {
        "body": len(scene.bodies),
        "drive": len(scene.drives),
        "contact": len(scene.contacts),
        "spring": len(scene.springs),
        "damper": len(scene.dampers),
        "force": len(scene.forces),
    }
    present = ", ".join(_count(number, name) for name, number in kinds.items() if number)
    lines = [f"Scene: {present}", *_states(system), *_contacts(system), *_loads(system)]
    kind = "sparse" if system.sparse else "dense"
    lines.append(f"Matrices: {kind} (bodies and contacts together: {system.n + system.m}, sparse above 100)")
    if system.parts:
        lines.append(f"Parts: {len(system.parts)} parts have nothing between them and are integrated apart")
    return lines


def _states(system: System) -> list[str]:
    moving = [*system.scene.bodies, *system.scene.drives]
    placed = [moving[i].name for i in system.placed]
    bristles = [system.scene.contacts[j].name for j in system.bristle_state]
    lines = [f"States: {system.size}", f"  {_count(system.n, 'velocity')}: {_listed(system.names)}"]
    if placed:
        lines.append(f"  {_count(len(placed), 'position')}, where springs act: {_listed(placed)}")
    else:
        lines.append("  no positions: no spring acts")
    if bristles:
        lines.append(f"  {_count(len(bristles), 'bristle deflection')}: {_listed(bristles)}")
    return lines


def _contacts(system: System) -> list[str]:
    contacts = system.scene.contacts
    if not contacts:
        return ["Contacts: none, so no modes and no guards"]
    alive = np.flatnonzero(system.alive).tolist()
    lines = [f"Contacts: {len(alive)} of {len(contacts)} assembled"]
    lines += [f"  {contacts[j].name}: {_contact(system, j)}" for j in alive[:_LISTED]]
    if len(alive) > _LISTED:
        lines.append(f"  ... and {len(alive) - _LISTED} more")
    frictionless = [c.name for j, c in enumerate(contacts) if system.mu_s[:, j].max() == 0]
    unloaded = [c.name for j, c in enumerate(contacts) if not (system.loaded[j] or c.name in frictionless)]
    for names, reason in ((frictionless, "frictionless"), (unloaded, "never loaded")):
        if names:
            lines.append(f"  left out, {reason}: {_listed(names)}")
    return lines


def _contact(system: System, j: int) -> str:
    contact = system.scene.contacts[j]
    return f"{contact.a} on {contact.b}, {_law(contact)}; {_guards(system, j)}; {_normal(contact)}"


def _law(contact: Contact) -> str:
    law = contact.law
    core = law if isinstance(law, DryFriction) else law.law  # type: ignore[attr-defined]
    text = f"{type(law).__name__}, static {core.mu_static:g}, Coulomb {core.mu_coulomb:g}"
    if core.dwell:
        text += f", dwell {core.dwell:g} s"
    if core.curved:
        text += ", kinetic curve"
    if hasattr(law, "velocity"):
        text += f", within {law.velocity:g} m/s | rad/s"
    return text


def _guards(system: System, j: int) -> str:
    if system.free[j]:
        return "no mode and no guard: its law is smooth"
    if system.hard[j]:
        rise = ", with the dwell's rise" if system.dwell[j] > 0 else ""
        return f"guards: 1 slipping (w), 2 stuck (B - r and B + r{rise})"
    return "guards: 1 slipping (|w| falls to 0.1 of the pre-slip velocity), 2 in pre-slip (|w| exceeds it)"


def _normal(contact: Contact) -> str:
    signal = as_signal(contact.normal, contact.label)
    if isinstance(signal, Constant):
        return f"normal force {signal.value:g} N"
    if signal.period is None:
        return "normal force piecewise linear; where it is 0 the contact is open and costs no guard"
    return "normal force curved; where it is 0 the contact is open and costs no guard"


def _loads(system: System) -> list[str]:
    loads = system.loads
    times = [f"{t:g}" for t in loads.breaks]
    stops = (
        f"{_count(len(times), 'break')}, stop times and not guards: {_listed(times)} s"
        if times
        else "no breaks"
    )
    lines = [f"Loads: {stops}"]
    if loads.curved.size:
        entries = _count(loads.curved.size, "load entry")
        lines.append(f"  {entries} not piecewise linear, shortest period {loads.period:g} s")
    elif times:
        lines.append("  piecewise linear: rates, forces and guards are affine between stops")
    return lines


# -- the result -------------------------------------------------------------------------------------------


def _watched(result: Result) -> list[str]:
    """Return which guards were watched in which sets of modes, and for how long."""
    seen: dict[bytes, tuple[NDArray[np.int8], list[float]]] = {}
    for piece in result._pieces:
        seen.setdefault(piece.modes.tobytes(), (piece.modes, []))[1].append(piece.stop - piece.start)
    outcome = "reached the end" if result.success else f"stopped early ({result.message})"
    lines = [f"Simulation: {outcome}; " + ", ".join(f"{k} {v}" for k, v in result.stats.items())]
    lines.append(f"Sets of modes met: {len(seen)}")
    for modes, times in list(seen.values())[:_MODE_SETS]:
        stretches = f"{sum(times):.4g} s in {_count(len(times), 'stretch')}"
        lines.append(f"  {stretches}: {_modes(result._system, modes)}")
    if len(seen) > _MODE_SETS:
        lines.append(f"  ... and {len(seen) - _MODE_SETS} more")
    return lines


def _modes(system: System, modes: NDArray[np.int8]) -> str:
    words = {
        Mode.STUCK: "stuck",
        Mode.FORWARD: "forward",
        Mode.BACKWARD: "backward",
        OPEN: "open",
        FREE: "smooth",
    }
    names: dict[str, list[str]] = {word: [] for word in words.values()}
    for contact, mode, alive in zip(system.scene.contacts, modes.tolist(), system.alive, strict=True):
        if alive:
            names[words[mode]].append(contact.name)
    guards = 2 * len(names["stuck"]) + len(names["forward"]) + len(names["backward"])
    return "; ".join(
        [_count(guards, "guard"), *(f"{word} {_listed(of)}" for word, of in names.items() if of)]
    )


def _count(number: int, name: str) -> str:
    if number == 1:
        return f"1 {name}"
    plural = name[:-1] + "ies" if name[-1] == "y" else name + ("es" if name.endswith("ch") else "s")
    return f"{number} {plural}"


def _listed(names: Iterable[str]) -> str:
    all_names = list(names)
    rest = len(all_names) - _LISTED
    return ", ".join(all_names[:_LISTED]) + (f", ... ({rest} more)" if rest > 0 else "")
