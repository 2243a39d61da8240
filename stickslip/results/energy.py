"""Where the energy of a motion comes from, is stored, and goes: a ledger that must balance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from stickslip.equations.algebra.matrices import Triplets
from stickslip.equations.system import System
from stickslip.model.arrays import Array
from stickslip.results.readable import Readable
from stickslip.results.samples import Samples, integrated

_CHANGES = "changes between runs"

# Energies before and after a restart that differ by this part are the same.
_SAME = 1e-14

# If the balance error exceeds this part of the largest energy, the effect of roundoff is computed.
_OFF = 1e-3

# Roundoff may give bodies this part of the impulses of all forces as momentum.
_ROUNDOFF = 1e-15


@dataclass(frozen=True, eq=False)
class EnergyLedger:
    """The energies of a motion at the times `t`, in J; work and heat count from the start.

    Attributes
    ----------
    t : array (n,)
        Times in s.
    kinetic, spring : array (n,)
        Stored in the bodies, and in the springs and gaps.
    loads, drives : array (n,)
        Work done on the scene by the forces, and by the drives through contacts, ties, clutches, springs and dampers.
    contacts : dict of str to array (n,)
        Heat of each contact by name; with bristle laws it includes the energy that the bristles store. Ties and
        one-way clutches make none.
    impacts : dict of str to array (n,)
        Energy lost at each stop and one-way clutch by name, in impacts and in jumps of drives.
    changes : array (n,)
        Stored energy gained between runs in a row, where one begins with another inertia, velocity or stretch than the
        one before ended with; 0 in a single run.
    dampers : dict of str to array (n,)
        Heat of each damper and of the damping of each spring and gap; labels that occur twice are numbered.
    roundoff : float
        Energy that roundoff of the forces may add. It is computed where the balance error is not small beside the
        other energies, else 0.
    """

    t: Array = field(repr=False)
    kinetic: Array = field(repr=False)
    spring: Array = field(repr=False)
    loads: Array = field(repr=False)
    drives: Array = field(repr=False)
    contacts: dict[str, Array] = field(repr=False)
    dampers: dict[str, Array] = field(repr=False)
    impacts: dict[str, Array] = field(repr=False)
    changes: Array = field(repr=False)
    roundoff: float = field(default=0.0, repr=False)

    def __post_init__(self) -> None:
        named = (self.contacts, self.dampers, self.impacts)
        single = (self.kinetic, self.spring, self.loads, self.drives, self.changes)
        for one in (*single, *(array for arrays in named for array in arrays.values())):
            one.flags.writeable = False

    @property
    def stored(self) -> Array:
        """Kinetic energy and energy of the springs."""
        return self.kinetic + self.spring

    @property
    def heat(self) -> Array:
        """Heat of all contacts, dampers and impacts together."""
        parts = (*self.contacts.values(), *self.dampers.values(), *self.impacts.values())
        return sum(parts, np.zeros_like(self.t))

    @property
    def work(self) -> Array:
        """Work of the loads and drives together."""
        return self.loads + self.drives

    @property
    def error(self) -> Array:
        """Error of the balance: stored energy gained since `t[0]`, plus heat, minus work and changes."""
        balance = self._balance
        return balance - balance[:1]

    @property
    def begun(self) -> float:
        """Energy stored at the start in J, before all work and heat; 0 where there are no times."""
        return float(self._balance[0]) if self.t.size else 0.0

    @property
    def _balance(self) -> Array:
        """Stored energy and heat, less work and changes, in J: but for errors, the energy stored at the start."""
        return self.stored + self.heat - self.work - self.changes

    @property
    def totals(self) -> dict[str, Array]:
        """Stored energies, work so far and changes between runs, if any, under their names in tables and drawings."""
        work = {"work of loads": self.loads, "work of drives": self.drives}
        changes = {_CHANGES: self.changes} if self.changes.any() else {}
        return {"kinetic": self.kinetic, "springs": self.spring, **work, **changes}

    @property
    def relative_error(self) -> float:
        """The largest balance error beyond roundoff over the largest energy in the ledger, 0 where nothing moves."""
        beyond = float(np.abs(self.error).max(initial=0.0)) - self.roundoff
        return beyond / self._largest if beyond > 0 else 0.0

    @property
    def _largest(self) -> float:
        sizes = (self.stored, self.heat, self.loads, self.drives)
        return max(float(np.abs(size).max(initial=0.0)) for size in sizes)

    def __str__(self) -> str:
        """Return the account at the last time as a table."""
        if not self.t.size:
            return "energy: there are no times"
        last = {name: energy[-1] for name, energy in self.totals.items()}
        changes = [(_CHANGES, last.pop(_CHANGES))] if _CHANGES in last else []
        rows = list(last.items())
        rows += [(f"heat of contact {name!r}", heat[-1]) for name, heat in self.contacts.items()]
        rows += [(f"heat of {label}", heat[-1]) for label, heat in self.dampers.items()]
        rows += [(f"impacts of {name!r}", heat[-1]) for name, heat in self.impacts.items()]
        rows += [*changes, ("balance error", self.error[-1])]
        wide = max(len(name) for name, _ in rows)
        # start velocities that are mere roundoff would be shown as some 1e-56 J
        stored = self.begun if self.begun > 1e-15 * self._largest else 0.0
        lines = [f"energy in J at {self.t[-1]:g} s (at the start {stored:.9g} stored)"]
        return "\n".join([*lines, *(f"  {name.ljust(wide)}  {value: .9g}" for name, value in rows)])


def energy(result: Readable) -> EnergyLedger:
    """Return the energy ledger of a result at its times.

    Powers are integrated on the polynomials of the steps, so that the balance error is that of the simulation. In runs
    in a row, heat and work go on from run to run; an element that a run does not have adds nothing during that run.
    """
    ledgers = [_ledger(run.samples) for run in result.runs]
    if len(ledgers) == 1:
        return ledgers[0]
    return _in_a_row(ledgers, [_at_ends(run.samples) for run in result.runs])


def losses(ledger: EnergyLedger) -> dict[str, Array]:
    """Return heats of contacts and dampers and losses in impacts, under their names in drawings and reports."""
    found = {f"heat of {name}": heat for name, heat in (ledger.contacts | ledger.dampers).items()}
    return found | {f"impacts of {name}": taken for name, taken in ledger.impacts.items() if taken.any()}


def _at_ends(samples: Samples) -> EnergyLedger:
    """Return the ledger of a run at its start and its end."""
    trajectory = samples.trajectory
    return _ledger(Samples.at_times(trajectory, np.array([trajectory.starts[0], trajectory.stops[-1]])))


def _change(before: float, after: float) -> float:
    """Return by how much an energy changes from run to run, 0 if that is roundoff."""
    return 0.0 if abs(after - before) <= _SAME * max(abs(before), abs(after)) else after - before


def _in_a_row(ledgers: Sequence[EnergyLedger], ends: Sequence[EnergyLedger]) -> EnergyLedger:
    """Return the ledgers of runs in a row as one; `ends` are the ledgers at the start and the end of each run."""
    sizes = [ledger.t.size for ledger in ledgers]

    def counted(read: Callable[[EnergyLedger], Array | None]) -> Array:
        so_far, parts = 0.0, []
        for ledger, end in zip(ledgers, ends, strict=True):
            own, last = read(ledger), read(end)
            parts.append(np.full(ledger.t.size, so_far) if own is None else so_far + own)
            so_far += 0.0 if last is None else float(last[-1])
        return np.concatenate(parts)

    def named(kind: str) -> dict[str, Array]:
        names = dict.fromkeys(name for ledger in ledgers for name in getattr(ledger, kind))
        return {name: counted(lambda ledger, name=name: getattr(ledger, kind).get(name)) for name in names}  # type: ignore[misc]

    t, kinetic, spring = (
        np.concatenate([getattr(ledger, kind) for ledger in ledgers]) for kind in ("t", "kinetic", "spring")
    )
    jumps = [0.0] + [_change(float(before.stored[-1]), float(after.begun)) for before, after in pairwise(ends)]
    return EnergyLedger(
        t,
        kinetic,
        spring,
        counted(lambda ledger: ledger.loads),
        counted(lambda ledger: ledger.drives),
        named("contacts"),
        named("dampers"),
        named("impacts"),
        np.repeat(np.cumsum(jumps), sizes),
        sum(ledger.roundoff for ledger in ledgers),
    )


def _ledger(samples: Samples) -> EnergyLedger:
    """Return the energy ledger of one run at some times."""
    if samples.t.size and not samples.trajectory.is_dense:
        raise ValueError(
            "energy: the points between the outputs were not kept, so no power can be integrated; "
            "simulate with dense_output=True"
        )
    system, springs = samples.system, _Springs(samples.system)
    names = [row.name for row in system.rows if row.kind == "friction"]
    labels, m = _labels(springs), len(names)
    work = integrated(samples, 2 + m + len(labels), lambda at: _powers(at, springs))
    heat = dict(zip(names, work[2 : 2 + m], strict=True))
    dampers = dict(zip(labels, work[2 + m :], strict=True))
    kinetic = 0.5 * system.inertia @ samples.y[: system.n] ** 2
    spring = 0.5 * springs.stiffness[:, 0] @ springs.depth(samples.y) ** 2
    by_drives, taken = _jumps(samples)
    drives, none = work[1] + by_drives, np.zeros(samples.t.size)
    found = EnergyLedger(samples.t, kinetic, spring, work[0], drives, heat, dampers, taken, none)
    return replace(found, roundoff=_roundoff(samples)) if found.relative_error > _OFF else found


def _roundoff(samples: Samples) -> float:
    """Return the kinetic energy that roundoff of all forces may give the bodies until the last time, in J."""
    system = samples.system
    heavy = system.inertia > 0
    # (impulse / sqrt(inertia))^2 is twice a kinetic energy
    lightness = np.divide(1.0, np.sqrt(system.inertia), out=np.zeros(system.n), where=heavy)
    by_y, by_q, by_r = (lightness @ abs(matrix) for matrix in (system.C, system.Q, system.G.T))

    def sizes(at: Samples) -> Array:
        return np.array([by_y @ np.abs(at.y) + by_q @ np.abs(at.inputs) + by_r @ np.abs(at.forces)])

    return 0.5 * float(_ROUNDOFF * integrated(samples, 1, sizes).max()) ** 2


def _jumps(samples: Samples) -> tuple[Array, dict[str, Array]]:
    """Return the work of drives by impulses of rows, and the energy lost at stops and one-way clutches.

    The run has kept the losses. The work of drives is ``(D^T r) u``, with u the mean of their velocities before and
    after, plus what the losses exceed ``r (w- + w+) / 2`` by. For a single impact that is 0.
    """
    trajectory, system = samples.trajectory, samples.system
    rows = (system.is_stop | system.is_one_way).nonzero()[0]
    by_drives = np.zeros(len(trajectory.pieces))
    taken = np.zeros((rows.size, by_drives.size))
    # impacts are kept with motions of the whole scene
    pieces = [piece for piece in trajectory.whole.pieces if piece.impulses is not None]
    if pieces:
        numbers = trajectory.numbers[0][[piece.impulses is not None for piece in trajectory.whole.pieces]]
        first, earlier = numbers == 0, np.maximum(numbers - 1, 0)
        before = Samples.at_local(trajectory, earlier, np.where(first, 0.0, trajectory.ends[earlier]))
        after = Samples.at_local(trajectory, numbers, np.zeros(numbers.size))
        impulses = np.array([piece.impulses for piece in pieces], dtype=float).T
        lost = np.array([piece.lost for piece in pieces], dtype=float).T
        taken[:, numbers] = lost[rows]
        if system.drives:
            mean = 0.5 * (before.drive_velocities + after.drive_velocities)
            middle = 0.5 * (before.relative_velocities + after.relative_velocities)
            by_drives[numbers] = ((system.D.T @ impulses) * mean).sum(axis=0)
            # Where a second impact follows at the same instant, drives have their new velocity in it, and the mean is
            # wrong: the losses tell by how much. At the very start drives have only one velocity.
            correction = lost[rows].sum(axis=0) - (impulses * middle)[rows].sum(axis=0)
            by_drives[numbers] += np.where(first, 0.0, correction)
    total = np.cumsum(taken, axis=1)[:, samples.piece_of]
    by_name = {system.rows[j].name: line for j, line in zip(rows.tolist(), total, strict=True)}
    return np.cumsum(by_drives)[samples.piece_of], by_name


class _Springs:
    """Springs and dampers, followed by gaps, as arrays.

    `couplings` is the number of springs and dampers, and `rows` are the rows of the gaps. A spring is a gap whose two
    limits are its rest. `ends` are the coefficients of all on bodies and drives; `damped` are those with damping.
    """

    def __init__(self, system: System) -> None:
        links, gaps = system.couplings, system.scene.gaps
        self.couplings, self.rows, self._system = len(links), system.is_gap.nonzero()[0], system
        self.labels = [one.label for one in (*links, *gaps)]
        self.stiffness, self.damping = (
            np.array([getattr(one, name) for one in (*links, *gaps)])[:, None] for name in ("stiffness", "damping")
        )
        self.damped = (self.damping[:, 0] > 0).nonzero()[0]
        rests = [link.rest for link in links]
        self._lower, self._upper = (
            np.array([*rests, *(getattr(gap, name) for gap in gaps)])[:, None] for name in ("lower", "upper")
        )
        rows = [*links, *(system.rows[j] for j in self.rows.tolist())]
        ends = Triplets()
        for k, row in enumerate(rows):
            for i, c in row.coefficients.items():
                ends.add(k, i, c)
        self.ends = system.matrix(ends, (len(rows), system.n + system.drives))

    def depth(self, y: Array) -> Array:
        """Return how far stretches are beyond upper limits, negative beyond lower ones, in m or rad."""
        positions = np.zeros((self.ends.shape[1], y.shape[1]))
        positions[self._system.placed] = y[self._system.n : self._system.first_bristle]
        stretch = self.ends @ positions
        return np.asarray(np.maximum(stretch - self._upper, 0.0) + np.minimum(stretch - self._lower, 0.0))


def _labels(springs: _Springs) -> list[str]:
    """Return the labels of elements with damping; a label that occurs again is numbered."""
    found: list[str] = []
    for name in (springs.labels[k] for k in springs.damped.tolist()):
        label, count = name, 1
        while label in found:
            count += 1
            label = f"{name} #{count}"
        found.append(label)
    return found


def _powers(at: Samples, springs: _Springs) -> Array:
    """Return the powers in W, a line each: of loads, of drives, heat of contacts, heat of dampers."""
    system, velocities = at.system, at.velocities()
    forces, count = at.forces, springs.couplings
    pushes = system.push_C @ at.y + system.push_Q @ at.inputs
    loads = (pushes * velocities[: system.n]).sum(axis=0)
    rates, elastic = springs.ends @ velocities, springs.stiffness * springs.depth(at.y)
    drag = springs.damping * rates
    # the damping force of a gap is clipped: it is the part of the force that is not elastic
    drag[count:] = forces[springs.rows] - elastic[count:]
    drives = np.zeros_like(loads)
    if system.drives:
        # a drive gives the power that rows and springs take from it
        given = system.D.T @ forces + springs.ends[:count, system.n :].T @ (elastic + drag)[:count]
        drives = (given * at.drive_velocities).sum(axis=0)
    heat = (forces * at.relative_velocities)[system.is_friction]
    return np.concatenate([[loads], [drives], heat, (drag * rates)[springs.damped]])
