"""The loads and drives of a scene that is followed part by part: straight lines in time, plus sines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip.engines.part_by_part.sine_shares import LinesWithSines, SineShares
from stickslip.equations.forest import Forest
from stickslip.equations.guards.at_start import ROUNDOFF
from stickslip.equations.loads.drives import Drives
from stickslip.equations.loads.loads import Segment
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array, Indices, Mask


class Prescribed:
    """Normal forces, drives, and forces on bodies between two breaks of the loads.

    The inputs of the motion must be straight but for sines. `go_on` leads beyond a break at which sines stay, and no
    velocity of a drive jumps.

    Attributes
    ----------
    start, stop : float
        The time span between two breaks.
    has_series : bool
        Whether springs, dampers or sines move bodies: else all is a polynomial.
    unit : float
        Series are in powers of the time over this unit.
    has_sines : bool
        Whether there are sines.
    feels_sines : array (n,) of bool
        Bodies that sines reach directly: by a force, or by a normal force or a drive of one of their rows.
    bends_with : array (d + 2,) of bool
        Whether a body need not follow a polynomial, for each lead: the drives, nothing, the ground.
    normal : array (m, 2)
        Normal forces at `start` and their slopes, without sines.
    normals, drive_velocities : LinesWithSines
        Normal forces and velocities of drives as series from any time on, with sines.
    rows : SineShares
        The sines of normal forces.
    drives : Drives
        Their motion, the same object beyond breaks that do not change it.
    force : array (n, 3)
        Forces on bodies in powers of the time since `start`, without sines.
    drive_size : array (d,)
        Summed sizes of the terms in the velocities of drives.
    """

    def __init__(self, forest: Forest, motion: Motion) -> None:
        self._system = system = motion.system
        # forces on bodies from the positions of drives
        self._pulls = system.C[:, system.carried_state]
        self._find_sines(forest, motion)
        self.has_series = forest.is_coupled or self.has_sines
        self.unit = forest.unit if self.has_series else motion.segment.stop - motion.t
        self._terms = forest.order + 1
        q, slope = motion.segment.taylor(motion.t, 1, sines=False)
        start = np.zeros(system.drives)
        start[system.carried] = motion.y[system.carried_state]
        self._move_drives(start, motion.t, q)
        self._enter(motion.t, motion.segment.stop, q, slope)

    def _enter(self, t: float, stop: float, q: Array, slope: Array) -> None:
        """Enter forces and normal forces from a time on, from the inputs there without sines and their slopes."""
        system = self._system
        self.start, self.stop = t, stop
        self.normal = np.stack([np.maximum(q[: system.m], 0.0), slope[: system.m]], axis=1)
        self.normals = LinesWithSines(self.normal, t, self.rows, self.unit, self._terms)
        d, (v, a) = t - self.drives.since, self.drives.velocity.T
        self.drive_size = np.abs(v + d * a) + self._drives.sizes
        self.force = np.zeros((system.n, 3))
        self.force[:, 0], self.force[:, 1] = system.Q @ q[: system.inputs], system.Q @ slope[: system.inputs]
        if (carried := system.carried).size:
            # springs to drives
            pulls = self._pulls
            self.force[:, 0] += pulls @ (self.drives.start + d * (v + 0.5 * d * a))[carried]
            self.force[:, 1] += pulls @ (v + d * a)[carried]
            self.force[:, 2] += pulls @ (0.5 * a)[carried]

    def go_on(self, before: Segment, after: Segment, bound: Mask) -> Mask | None:
        """Go on beyond a break of the loads; return which rows' and which bodies' forces change (m + n,).

        A row feels its normal force and its drives. None, and nothing has changed, where sines are others, the velocity
        of a drive jumps, or a drive kinks that has sines or one of the rows that are `bound`.
        """
        system, t = self._system, after.start
        own, others = before.sines, after.sines
        if not (np.array_equal(own.entry, others.entry) and np.array_equal(own.numbers, others.numbers)):
            return None
        line = before.line(t)
        jumps = np.abs(after.value - line) > ROUNDOFF * (np.abs(after.value) + np.abs(line))
        changes = jumps | (after.slope != before.slope)
        kinks: Mask = np.logical_or(system.drive_velocities(changes), system.drive_accelerations(changes))
        rows, bodies = changes[: system.m], system.abs_Q @ changes[: system.inputs] > 0
        if kinks.any():
            # where a drive comes to rest in a corner, the roundoff of the time makes a small jump
            late = ROUNDOFF * abs(t) * np.abs(system.drive_accelerations(line))
            before_t, after_t = system.drive_velocities(line), system.drive_velocities(after.value)
            smooth = np.abs(after_t - before_t) <= ROUNDOFF * (np.abs(before_t) + np.abs(after_t)) + late
            feels_kinks = system.abs_D @ kinks > 0
            if self._drives.has_any or not smooth.all() or (feels_kinks & bound).any():
                return None
            rows = rows | feels_kinks
            positions = self.drives.positions(np.arange(system.drives), np.array([t]))[:, 0]
            self._move_drives(positions, t, after.value)
            bodies |= abs(self._pulls) @ kinks[system.carried] > 0
        self._enter(t, after.stop, after.value, after.slope)
        return np.concatenate([rows, bodies])

    def _move_drives(self, start: Array, t: float, q: Array) -> None:
        """Let all drives go on from positions at time `t` with the velocities and accelerations of inputs."""
        system = self._system
        u = np.stack([system.drive_velocities(q), system.drive_accelerations(q)], axis=1)
        self.drives = Drives(start, u, t, self._drives.sines)
        self.drive_velocities = LinesWithSines(u, t, self._drives, self.unit, self._terms)

    def _find_sines(self, forest: Forest, motion: Motion) -> None:
        """Find the sines among normal forces, velocities of drives, and forces on bodies."""
        system, sines = motion.system, motion.segment.sines
        self.rows = SineShares.among(sines, sines.entry, system.m)
        drive = sines.entry - system.first_drive
        self._drives = SineShares.among(replace(sines, entry=drive), drive, system.drives)
        self.has_sines = bool(sines.entry.size)
        self._bodies = self._springs = SineShares.none(system.n)
        if self.has_sines:
            self._bodies = SineShares.of(sines, system.Q[:, sines.entry])
        pulling = np.isin(drive, system.carried).nonzero()[0]
        if pulling.size:
            # springs to drives with sines
            places = [system.position_state[system.n + k] for k in drive[pulling].tolist()]
            self._springs = SineShares.of(sines.some(pulling), system.C[:, places], motion.t)
        self.feels_sines = self._bodies.have_sines | self._springs.have_sines
        rows = self.rows.have_sines | (forest.drive >= 0) & np.append(self._drives.have_sines, False)[forest.drive]
        ends = np.concatenate([forest.child[rows], forest.parent[rows]])
        self.feels_sines[ends[ends >= 0]] = True
        self.bends_with = np.concatenate([self._drives.have_sines, [True, False]])

    def sine_forces(self, bodies: Indices, t: float) -> Array:
        """Return the forces of sines on some bodies as series about `t`."""
        found = self._bodies.series(bodies, t, self._terms, self.unit)
        if self._springs.has_any:
            found += self._springs.series(bodies, t, self._terms, self.unit)
        return found

    def normal_at(self, j: int, t: float) -> float:
        """Return one normal force at time `t` without its sines, as a measure of its size."""
        return float(self.normal[j, 0] + (t - self.start) * self.normal[j, 1])

    @property
    def drives_have_sines(self) -> bool:
        """Whether the velocity of a drive has sines."""
        return self._drives.has_any

    def drive_at(self, k: int, t: float) -> tuple[float, float]:
        """Return velocity and acceleration of a drive at time `t`; those of the ground, which is -1, are 0."""
        if k < 0:
            return 0.0, 0.0
        start, slope = self.drives.velocity[k].tolist()
        v, a = self._drives.series(np.array([k]), t, 2, 1.0)[0].tolist() if self._drives.has_any else (0.0, 0.0)
        return start + (t - self.drives.since) * slope + v, slope + a

    def drive_series(self, t: float) -> Array:
        """Return the velocities of all drives as series about `t`, as long as those of bodies."""
        u = self.drive_velocities(np.arange(self.drive_size.size), t)
        found = np.zeros((u.shape[0], self._terms))
        found[:, : u.shape[1]] = u
        return found

    def drive_positions(self, drives: Indices, t: float) -> Array:
        """Return the positions of drives as series about `t`."""
        terms = self._terms if self._drives.has_any else 3
        found = self.drives.moved(drives, t, self.unit, terms - 1)
        found[:, 0] = self.drives.positions(drives, np.array([t]))[:, 0]
        return found

    def drive_acceleration_majorant(self, k: int) -> float:
        """Return the majorant of the acceleration of a drive."""
        return float(np.abs(self.drives.velocity[k, 1]) + self._drives.rate_sizes[k])
