"""Where the energy of a motion comes from, is stored, and goes: a ledger that must balance."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip.pieces import Piece
from stickslip.result import Result
from stickslip.sampling import is_dense, sampled
from stickslip.scene import GROUND, Damper, Scene, Spring
from stickslip.signals import as_signal

__all__ = ["EnergyLedger", "energy"]

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_PER_PERIOD = 8
_AT_ONCE = 50_000
_LOADS, _DRIVES = 0, 1
_FIRST_CONTACT = 2


@dataclass(frozen=True)
class EnergyLedger:
    """The energies of a motion at the times `t`, in J; work and heat count from the start.

    Attributes
    ----------
    t : array (n,)
        Times in s.
    kinetic, spring : array (n,)
        Stored in the bodies and in the springs.
    loads, drives : array (n,)
        Work done on the scene by the forces, and by the drives through contacts, springs and dampers.
    contacts : dict of str to array (n,)
        Heat of each contact by name; with bristle laws it holds what the bristles store, too.
    dampers : dict of str to array (n,)
        Heat of each damper and of each spring's damping; a label that returns is numbered.
    """

    t: Array = field(repr=False)
    kinetic: Array = field(repr=False)
    spring: Array = field(repr=False)
    loads: Array = field(repr=False)
    drives: Array = field(repr=False)
    contacts: dict[str, Array] = field(repr=False)
    dampers: dict[str, Array] = field(repr=False)

    @property
    def stored(self) -> Array:
        """Kinetic energy and energy of the springs."""
        return self.kinetic + self.spring

    @property
    def heat(self) -> Array:
        """Heat of all contacts and dampers together."""
        return sum((*self.contacts.values(), *self.dampers.values()), np.zeros_like(self.t))

    @property
    def work(self) -> Array:
        """Work of the loads and drives together."""
        return self.loads + self.drives

    @property
    def error(self) -> Array:
        """What the balance is off: stored energy gained, plus heat, minus work; it starts at `t[0]`."""
        balance = self.stored + self.heat - self.work
        return balance - balance[:1]

    @property
    def relative_error(self) -> float:
        """The largest balance error over the largest energy in the ledger, 0 where nothing ever moves."""
        sizes = (self.stored, self.heat, self.loads, self.drives)
        largest = max(float(np.abs(size).max(initial=0.0)) for size in sizes)
        return float(np.abs(self.error).max(initial=0.0)) / largest if largest > 0 else 0.0

    def __str__(self) -> str:
        """Return the account at the last time as a table."""
        if not self.t.size:
            return "energy: nothing was computed"
        rows = [("kinetic", self.kinetic[-1]), ("springs", self.spring[-1])]
        rows += [("work of loads", self.loads[-1]), ("work of drives", self.drives[-1])]
        rows += [(f"heat of contact {name!r}", heat[-1]) for name, heat in self.contacts.items()]
        rows += [(f"heat of {label}", heat[-1]) for label, heat in self.dampers.items()]
        rows.append(("balance error", self.error[-1]))
        wide = max(len(name) for name, _ in rows)
        lines = [f"energy in J at {self.t[-1]:g} s (at the start {self.stored[0]:.9g} stored)"]
        return "\n".join([*lines, *(f"  {name.ljust(wide)}  {value: .9g}" for name, value in rows)])


def energy(result: Result) -> EnergyLedger:
    """Return the energy ledger of a result at its times.

    Power is integrated on the interpolated motion between the computed points, so that the balance error is
    that of the simulation.

    Parameters
    ----------
    result : Result

    Raises
    ------
    ValueError
        If only the requested outputs were kept.
    """
    if result.t.size and not is_dense(result):
        raise ValueError(
            "energy: the points between the outputs were not kept, so no power can be integrated; "
            "simulate with dense_output=True"
        )
    links = _damped(result.scene)
    work = _integrated(result, list(links.values()))
    names = [contact.name for contact in result.scene.contacts]
    heat = dict(zip(names, work[_FIRST_CONTACT:], strict=False))
    dampers = dict(zip(links, work[_FIRST_CONTACT + len(names) :], strict=True))
    kinetic = 0.5 * result._system.inertia @ result.y[: result._system.n] ** 2
    return EnergyLedger(result.t, kinetic, _springs(result), work[_LOADS], work[_DRIVES], heat, dampers)


def _damped(scene: Scene) -> dict[str, Spring | Damper]:
    found: dict[str, Spring | Damper] = {}
    links: list[Spring | Damper] = [*scene.springs, *scene.dampers]
    for link in links:
        if link.damping > 0:
            label, count = link.label, 1
            while label in found:
                count += 1
                label = f"{link.label} #{count}"
            found[label] = link
    return found


def _springs(result: Result) -> Array:
    total = np.zeros_like(result.t)
    for spring in result.scene.springs:
        if spring.stiffness:
            total += 0.5 * spring.stiffness * _stretch(result, spring) ** 2
    return total


def _stretch(result: Result, spring: Spring) -> Array:
    return result.position(spring.a) - result.position(spring.b) - spring.rest


def _powers(at: Result, links: Iterable[Spring | Damper]) -> Array:
    """Return the powers in W, a row each: loads, drives, contacts' heat, dampers' heat."""
    scene = at.scene
    moving = [body.name for body in scene.bodies] + [drive.name for drive in scene.drives]
    velocity = {name: at.velocity(name) for name in moving} | {GROUND: np.zeros_like(at.t)}
    loads, drives = np.zeros_like(at.t), np.zeros_like(at.t)
    for force in scene.forces:
        signal = as_signal(force.signal, force.label)
        loads += np.array([signal(t) for t in at.t.tolist()]) * velocity[force.body]
    prescribed = {drive.name for drive in scene.drives}

    def drive_through(a: str, b: str, pull: Array) -> None:
        # pull acts on a, and against b: a drive gives the opposite of what acts on it
        nonlocal drives
        if a in prescribed:
            drives -= pull * velocity[a]
        if b in prescribed:
            drives += pull * velocity[b]

    heat = []
    for contact in scene.contacts:
        force_on_b = at.force(contact.name)
        heat.append(force_on_b * (velocity[contact.a] - velocity[contact.b]))
        drive_through(contact.a, contact.b, -force_on_b)
    for spring in scene.springs:
        if spring.stiffness and {spring.a, spring.b} & prescribed:
            drive_through(spring.a, spring.b, -spring.stiffness * _stretch(at, spring))
    for link in links:
        w = velocity[link.a] - velocity[link.b]
        heat.append(link.damping * w * w)
        drive_through(link.a, link.b, -link.damping * w)
    return np.array([loads, drives, *heat])


def _integrated(result: Result, links: list[Spring | Damper]) -> Array:
    """Return the time integrals of the powers at the result's times, five-point Gauss on each step."""
    pieces, rows = result._pieces, _FIRST_CONTACT + len(result.scene.contacts) + len(links)
    out, base = np.zeros((rows, result.t.size)), np.zeros(rows)
    order = np.argsort(result._piece_of, kind="stable")
    chosen = np.split(order, np.searchsorted(result._piece_of[order], np.arange(1, len(pieces))))
    local = [np.clip(result.t[c] - p.start, 0.0, p.taus[-1]) for c, p in zip(chosen, pieces, strict=False)]
    edges = [_edges(result, piece, taus) for piece, taus in zip(pieces, local, strict=True)]
    for block in _blocks([edge.size for edge in edges]):
        steps = _work_of_steps(result, block, edges, links)
        for number, work in zip(block, steps, strict=True):
            sums = base[:, None] + np.cumsum(np.pad(work, ((0, 0), (1, 0))), axis=1)
            out[:, chosen[number]] = sums[:, np.searchsorted(edges[number], local[number])]
            base = sums[:, -1]
    return out


def _work_of_steps(
    result: Result, block: list[int], edges: list[Array], links: list[Spring | Damper]
) -> list[Array]:
    """Return for each piece of a block the work between its edges, a row per power."""
    nodes = []
    for number in block:
        middle, half = 0.5 * (edges[number][1:] + edges[number][:-1]), 0.5 * np.diff(edges[number])
        nodes.append((middle[:, None] + half[:, None] * _NODES).ravel())
    powers = _powers(sampled(result, block, nodes), links)
    widths = np.concatenate([0.5 * np.diff(edges[number]) for number in block])
    work = (powers.reshape(powers.shape[0], -1, _NODES.size) @ _WEIGHTS) * widths
    return np.split(work, np.cumsum([edges[number].size - 1 for number in block])[:-1], axis=1)


def _edges(result: Result, piece: Piece, wanted: Array) -> Array:
    """Return the local times between which power is smooth: computed points, outputs, parts of a period."""
    edges = np.union1d(piece.taus, wanted)
    loads = result._system.loads
    if loads.curved.size and piece.taus[-1] > 0:
        parts = int(np.ceil(_PER_PERIOD * piece.taus[-1] / loads.period))
        edges = np.union1d(edges, np.linspace(0.0, piece.taus[-1], parts + 1))
    return edges


def _blocks(sizes: list[int]) -> Iterable[list[int]]:
    """Yield runs of pieces that are evaluated together, none too large for memory."""
    block: list[int] = []
    total = 0
    for number, size in enumerate(sizes):
        if block and total + size > _AT_ONCE:
            yield block
            block, total = [], 0
        block.append(number)
        total += size
    if block:
        yield block
