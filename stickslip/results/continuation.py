"""Going on where a run has ended: its last state as a scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.guards.at_start import FINEST_ROUNDOFF, ROUNDOFF
from stickslip.equations.guards.values import AT_BAND
from stickslip.equations.mode_equations import AT_HIGH, AT_LOW, no_body_moves
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Mask, Modes
from stickslip.model.elements import Block, Body, Contact, Drive, Sampled, StateSpace
from stickslip.model.scene import Scene
from stickslip.results.samples import Samples
from stickslip.results.trajectory import NOTHING_KEPT, Trajectory


def final_scene(trajectory: Trajectory) -> Scene:
    """Return the scene at the end of a motion: simulated from that time on, it goes on as the motion would have.

    Velocities, positions, times at rest, bristles, slip states, states of blocks and sample clocks are those of the
    end. Loads stay as they are: they are functions of the same time.
    """
    if not trajectory.pieces:
        raise ValueError(f"final_scene: {NOTHING_KEPT}")
    if not trajectory.is_dense:
        raise ValueError("final_scene: the points between the outputs were not kept; simulate with dense_output=True")
    system, number = trajectory.system, np.array([trajectory.starts.size - 1])
    end, stop = trajectory.ends[-1:], float(trajectory.stops[-1])
    at = Samples.at_local(trajectory, number, end)
    inner, shown = (table[:, 0] for table in trajectory.modes(number, end))
    since = trajectory.since_when(number, end)[:, 0]
    fastest = _fastest(trajectory, at)
    velocities = _velocities(at, fastest, shown)
    # A row that was inside Karnopp's dead band when the last piece began moves on there. A row that has only come to
    # the edge of the band sticks.
    begun = Samples.at_local(trajectory, number, np.zeros(1)).relative_velocities[:, 0]
    moves_on = np.abs(begun) <= (1 + AT_BAND) * system.laws.rests_below
    farthest = np.zeros(system.n + system.drives)
    farthest[: system.n] = fastest * (stop - trajectory.span.start) + [abs(b.position) for b in system.scene.bodies]
    y = on_stops(system, at.y[:, 0], inner, farthest)
    # If an event stops a run right after a sample, the next run takes that sample again, from the values before it.
    earlier = (trajectory.starts < stop).nonzero()[0][-1:]
    before = Samples.at_local(trajectory, earlier, trajectory.ends[earlier]) if earlier.size else None
    sampled: dict[str, dict[str, Any]] = {}
    for block in system.scene.sampled:
        sampled[block.name] = {"first": trajectory.span.start if block.first is None else block.first}
        if before is not None:
            held, states = before.outputs_of(block.name)[:, 0].tolist(), before.states_of(block.name)[:, 0].tolist()
            sampled[block.name] |= {"states": states, "held": held, "outputs": len(held)}
    return in_state(
        system.scene,
        system,
        y,
        velocities=velocities,
        positions={name: _position(at, y, name) for name in [*velocities, *(d.name for d in system.scene.drives)]},
        rested=np.where(shown == 0, stop - since, 0.0),
        slipping=(np.abs(inner) == 1) & (~system.hard | moves_on),
        sampled=sampled,
    )


def in_state(
    scene: Scene,
    system: System,
    y: Array,
    *,
    velocities: Mapping[str, float],
    positions: Mapping[str, float],
    rested: Array,
    slipping: Mask,
    sampled: Mapping[str, Mapping[str, Any]],
) -> Scene:
    """Return a scene that starts in a state: bristles and blocks are taken from `y`, all else by name or row.

    `rested` (m,) in s and `slipping` (m,) are the fields of contacts with these names, for each row.
    """
    elements: list[Any] = []
    for element in scene.elements:
        changes: dict[str, Any] = {}
        match element:
            case Body(name=name) | Drive(name=name):
                changes = {"velocity": velocities[name]} if name in velocities else {}
                if name in positions:
                    changes["position"] = positions[name]
            case Contact(name=name):
                j = system.row_index[name]
                bristle = system.bristle_state.get(j)
                changes = {
                    "rested": float(rested[j]),
                    "deflection": 0.0 if bristle is None else float(y[bristle]),
                    "slipping": bool(slipping[j]),
                }
            case Block(name=name) | StateSpace(name=name):
                place = system.blocks[name]
                changes = {"states": y[place.first : place.end].tolist()}
            case Sampled(name=name):
                changes = dict(sampled.get(name, {}))
        one: Any = element
        elements.append(replace(one, **changes) if changes else one)
    return Scene(*elements, motion=scene.motion)


def _position(at: Samples, y: Array, name: str) -> float:
    """Return the position of a body or drive, from `y` where it is a state."""
    state = at.system.position_state.get(at.body(name))
    return float(at.position(name)[0] if state is None else y[state])


def on_stops(system: System, y: Array, modes: Modes, farthest: Array) -> Array:
    """Return a state in which no stop is beyond its limit, neither a closed one nor one that is about to strike.

    Positions keep the roundoff of the largest earlier ones, `farthest` (n + drives,). At a limit of 0, a stop would
    seem to fly by this roundoff, so positions of that size are set to 0 there.
    """
    functions = system.piecewise
    if not functions.is_stop.any():
        return y
    q = np.zeros(system.inputs)
    q[-1] = 1.0
    upper, lower, _ = functions.limits(y, q, y)
    is_upper = upper < lower
    # a stop whose load other rows carry is at its level, which is no force, and is closed all the same
    closed = functions.is_stop & (np.isin(modes[functions.row], (0, AT_HIGH, AT_LOW)) | (np.minimum(upper, lower) < 0))
    if not closed.any():
        return y
    change = np.where(is_upper, np.minimum(upper, 0.0), np.maximum(-lower, 0.0))[closed]
    # with all positions 0, the distances to the limits are the limits themselves
    upper, lower, _ = functions.limits(np.zeros_like(y), q, y)
    limits = np.where(is_upper, upper, lower)[closed]
    rows = functions.row[closed]
    lines = np.hstack([dense(system.G[rows]), dense(system.D[rows])])[:, system.placed]
    found = y.copy()
    places = found[system.n : system.first_bristle]
    places += np.linalg.lstsq(lines, change, rcond=None)[0]
    members = lines != 0
    rough = FINEST_ROUNDOFF * np.where(members, farthest[system.placed], 0.0).max(axis=1)
    at_0 = (limits == 0) & (np.where(members, np.abs(places), 0.0).max(axis=1) <= rough)
    places[members[at_0].any(axis=0)] = 0.0
    return found


def _fastest(trajectory: Trajectory, last: Samples) -> Array:
    """Return the largest speed of each body at the starts of all pieces and at the end."""
    every = np.arange(trajectory.starts.size)
    begun, n = Samples.at_local(trajectory, every, np.zeros(every.size)), trajectory.system.n
    found: Array = np.maximum(np.abs(begun.y[:n]).max(axis=1), np.abs(last.y[:n, 0]))
    return found


def _velocities(at: Samples, fastest: Array, modes: Modes) -> dict[str, float]:
    """Return the velocities of the bodies at the one time of `at`, at which rows show these modes.

    A row that has just come to rest may keep roundoff of its former speed: it is set to rest. So is a row whose
    relative velocity has passed 0 by a solver's error, while its mode is still the old one. One-way clutches must not
    turn forward, not even by roundoff.
    """
    system = at.system
    v, w = at.y[: system.n, 0], at.relative_velocities[:, 0]
    u = at.drive_velocities[:, 0] if system.drives else np.empty(0)
    rough = ROUNDOFF * (system.abs_G @ fastest)
    if system.drives:
        rough += ROUNDOFF * (system.abs_D @ np.abs(u))
    has_passed = (np.abs(modes) == 1) & (modes * w < 0)
    rests = system.hard & ((np.abs(w) <= rough) | has_passed)
    if (moves := (rests & (modes != 0)).nonzero()[0]).size:
        # rows that STUCK ones lock follow drives, which may just pass 0: to set them to rest would move the STUCK ones
        balance = system.balance((rests & (modes == 0)) | system.is_tie)
        rests[moves[no_body_moves(system.G[moves], balance, system.largest_lever[moves])]] = False
    held = (rests & (w != 0)) | (system.is_one_way & (w > 0))
    if held.any():
        v = system.balance(held | rests | system.is_tie).project(v, u)
    return dict(zip(system.names, v.tolist(), strict=True))
