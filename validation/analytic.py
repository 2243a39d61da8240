"""Exact answers for dry friction, to check simulations against.

Nothing here imports the package or integrates a differential equation: between two events the motion is a
closed form, and events are roots of closed forms. All numbers are mpmath's, with 40 digits; `mp.dps` of this
module changes that. Units are SI and read the same for rotation: kg as kg m², N as N m, m/s as rad/s.

Modes are -1 (backward), 0 (stuck) and +1 (forward): the sign of the relative velocity w = v_a - v_b of a
contact between a and b. Its friction force r opposes w > 0: the force on a is -r, on b it is +r.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import mpmath
from mpmath import mpf

mp = mpmath.mp.clone()  # a context of our own: the precision set elsewhere is neither used nor changed
mp.dps = 40

Number: TypeAlias = int | float | str | Fraction | mpf
Triangle: TypeAlias = tuple[Number, Number, Number]

BACKWARD, STUCK, FORWARD = -1, 0, 1


def exact(x: Number) -> mpf:
    """Return a number as it was meant: a float stands for the decimal it prints as, so 1.01 is 101/100."""
    return mp.convert(repr(float(x)) if isinstance(x, float) else x)


def _roundoff() -> mpf:
    """Return the relative size below which a number that should be zero is taken for zero."""
    return mp.mpf(10) ** (10 - mp.dps)


def _require(condition: bool, what: str) -> None:
    if not condition:
        raise ValueError(f"this closed form does not apply: {what}")


def _unrisen(mu_s: mpf, mu_c: mpf, dwell: mpf, rest: mpf) -> mpf:
    """Return what the dwell still withholds of mu_s after a time of rest, eq. (9)."""
    return (mu_s - mu_c) * mp.exp(-rest / dwell) if dwell else mp.zero


def _root(f: Callable[[mpf], mpf], a: mpf, b: mpf) -> mpf:
    """Return the root of a continuous function between two points where its signs differ."""
    return mp.findroot(f, (a, b), solver="anderson", maxsteps=1000)


class Event(NamedTuple):
    """A contact changes its mode at a time [s]."""

    time: mpf
    contact: str
    before: int
    after: int


@dataclass(frozen=True)
class Motion:
    """The events of a motion in order of time, and its velocities [m/s or rad/s] at any time [s]."""

    events: tuple[Event, ...]
    velocity: Callable[[Number], tuple[mpf, ...]]


# Two flywheels, written out


def two_flywheels(
    inertias: tuple[Number, Number] = (1, 10),
    speeds: tuple[Number, Number] = (1, 1.01),
    *,
    mu_static: Number = 0.2,
    mu_coulomb: Number = 0.1,
    dwell: Number = 0.1,
    normal: Number = 100,
    slope: Number = 3000,
    triangles: tuple[Triangle, Triangle] = ((0.05, 0.10, 0.15), (0.4, 0.5, 0.6)),
) -> Motion:
    """Two flywheels, an interface between them and a brake on the first: the benchmark, phase by phase.

    m1 v1' = -r_i - r_b, m2 v2' = r_i, with |r| = mu_c N where a contact slips, and a stuck contact breaks at
    (mu_s - (mu_s - mu_c) exp(-(t - t_start)/dwell)) N. The story is: the interface locks; it holds through
    the first triangle of the brake; on the rising side of the second it breaks; on the falling side wheel 1
    stops and is dragged off again; after the brake the wheels lock. Other stories raise ValueError.

    inertias [kg m²], speeds [rad/s], dwell [s], normal: of the interface, at unit arm [N], slope: of the
    rising normal force of the brake [N/s], triangles: (start, peak, stop) of that force [s].
    Source: Breedveld 2000, section 3, table 1, eqs. (1), (8), (9).
    """
    m1, m2, v10, v20 = map(exact, (*inertias, *speeds))
    mu_s, mu_c, tau, load, rise = map(exact, (mu_static, mu_coulomb, dwell, normal, slope))
    first, second = (tuple(map(exact, triangle)) for triangle in triangles)
    total, grip = m1 + m2, mu_c * load  # grip: the force of the slipping interface
    fall = [rise * (peak - start) / (stop - peak) for start, peak, stop in (first, second)]
    kinks = [
        kink
        for (start, peak, stop), down in zip((first, second), fall, strict=True)
        for kink in ((start, rise), (peak, -rise - down), (stop, down))
    ]

    def brake(t: mpf) -> mpf:  # normal force of the brake
        return sum(change * max(t - kink, 0) for kink, change in kinks)

    def impulse(t: mpf) -> mpf:  # of the brake slipping forward, since 0
        return mu_c * sum(change * max(t - kink, 0) ** 2 for kink, change in kinks) / 2

    def unrisen(rest: mpf) -> mpf:
        return _unrisen(mu_s, mu_c, tau, rest)

    # The interface slips until the wheels are equally fast.
    lock = (v20 - v10) / (grip * (1 / m1 + 1 / m2))
    _require(0 < lock <= first[0], "wheel 2 must start faster, and lock before the first triangle")
    common = (m1 * v10 + m2 * v20) / total

    # Case 1. Up to the peak the load on the interface is linear and its limit concave; after it one falls and
    # the other rises: what holds at the peak holds throughout.
    share = m2 / total  # of the brake's force, passed on by the stuck interface, eq. (1)
    limit = (mu_s - unrisen(first[1] - lock)) * load
    _require(share * mu_c * brake(first[1]) <= limit, "the interface must hold through the first triangle")

    # Case 2: share mu_c rise s = (mu_s - u exp(-s/tau)) N at s = slip - start. Its left side less its right
    # is convex and negative at s = 0, so the root is the larger of two: the principal branch of Lambert's W.
    ramp = share * mu_c * rise
    after = mu_s * load / ramp
    if tau:
        withheld = unrisen(second[0] - lock) * load / (ramp * tau)
        after += tau * mp.lambertw(-withheld * mp.exp(-after / tau))
    slip = second[0] + after
    _require(first[2] <= second[0], "the second triangle must come after the first")
    _require(slip < second[1], "the interface must break while the second triangle rises")
    joint = common - impulse(slip) / total
    _require(joint > 0, "both wheels must still turn when the interface breaks")

    def dragged(t: mpf, since: mpf) -> mpf:  # gain of wheel 1 while interface and brake slip
        return (grip * (t - since) - impulse(t) + impulse(since)) / m1

    # Wheel 1 stops at the first root of a quadratic in the time since the peak.
    at_peak = joint + dragged(second[1], slip)
    slowing = (mu_c * brake(second[1]) - grip) / m1
    discriminant = slowing**2 - 2 * at_peak * mu_c * fall[1] / m1
    stops = at_peak > 0 and slowing > 0 and discriminant > 0
    _require(stops, "wheel 1 must stop while the second triangle falls")
    stop = second[1] + 2 * at_peak / (slowing + mp.sqrt(discriminant))

    # The brake, loaded by grip, breaks when its limit has come down to it. The limit lies between mu_c N_b
    # and mu_s N_b, and (mu_s - u) - grip/N_b is concave and positive at first: one root between these times.
    early, late = (second[2] - grip / mu / fall[1] for mu in (mu_c, mu_s))

    def excess(t: mpf) -> mpf:
        return grip - (mu_s - unrisen(t - stop)) * brake(t)

    drag = _root(excess, early, late) if tau and mu_s > mu_c else late
    _require(joint > grip * (drag - slip) / m2, "wheel 2 must still turn when wheel 1 is dragged off")

    # Without the brake both velocities are straight lines, which meet.
    gap = joint - grip * (second[2] - slip) / m2 - dragged(second[2], drag)
    _require(gap > 0, "the brake must be off before the wheels lock")
    relock = second[2] + gap / (grip * (1 / m1 + 1 / m2))
    final = joint - grip * (relock - slip) / m2

    def velocity(time: Number) -> tuple[mpf, mpf]:
        t = exact(time)
        _require(t >= 0, "time must not be negative")
        if t < lock:
            return v10 + grip * t / m1, v20 - grip * t / m2
        if t < slip:
            v = common - impulse(t) / total
            return v, v
        if t >= relock:
            return final, final
        v2 = joint - grip * (t - slip) / m2
        if t < stop:
            return joint + dragged(t, slip), v2
        return (dragged(t, drag) if t >= drag else mp.zero), v2

    return Motion(
        (
            Event(lock, "interface", BACKWARD, STUCK),
            Event(slip, "interface", STUCK, BACKWARD),
            Event(stop, "brake", FORWARD, STUCK),
            Event(drag, "brake", STUCK, FORWARD),
            Event(relock, "interface", BACKWARD, STUCK),
        ),
        velocity,
    )


# Chains of flywheels, from event to event


@dataclass(frozen=True)
class Contact:
    """A dry contact: coefficients [-], dwell time [s] and normal force [N].

    The normal force is a number or points (time, force): linear between them, constant before and after.
    """

    name: str
    mu_static: Number
    mu_coulomb: Number
    dwell: Number
    normal: Number | Sequence[tuple[Number, Number]]


def chain(
    inertias: Sequence[Number], speeds: Sequence[Number], contacts: Sequence[Contact], until: Number
) -> Motion:
    """Flywheels in a row, each rubbing on the next, and a brake on the first: any story, from event to event.

    Wheel k: m_k v_k' = T_k - T_(k+1), where T_k is the force of the contact on its left, and T_(n+1) = 0.
    Between events the normal forces are linear in time, so all forces are and the velocities are quadratic:
    a slipping contact stops at the root of a quadratic, a stuck one breaks at a root of
    line + line exp(-s/dwell).

    inertias [kg m²], speeds [rad/s], until: the end of the motion [s]; contacts: the brake (wheel 1 against
    the ground) first, then the interfaces from left to right.
    Source: Newton's law for each wheel; Breedveld 2000, eqs. (1), (8), (9), extended to several contacts.
    """
    if not len(inertias) == len(speeds) == len(contacts):
        raise ValueError("a chain has as many speeds and contacts, the brake among them, as it has inertias")
    row = _Row([exact(m) for m in inertias], [_Law.of(contact) for contact in contacts])
    t, end, v = mp.zero, exact(until), [exact(speed) for speed in speeds]
    modes = [int(mp.sign(w)) for w in row.relative(v)]
    since = [t] * len(contacts)  # when each contact last became stuck
    near = _roundoff() * max(map(abs, v))  # friction never makes a wheel the fastest yet
    events: list[Event] = []
    starts: list[mpf] = []
    pieces: list[list[tuple[mpf, mpf, mpf]]] = []

    while not starts or t < end:
        zero = [abs(w) <= near for w in row.relative(v)]
        v = row.join(v, zero)  # exactly equal velocities, so that stuck contacts cannot drift
        before, modes = modes, row.settle(t, modes, zero, since)
        since = [old if mode == STUCK else t for old, mode in zip(since, before, strict=True)]
        if starts:
            changes = zip(contacts, before, modes, strict=True)
            events += [Event(t, contact.name, old, new) for contact, old, new in changes if old != new]
        (_, a), (_, jerk) = row.solve(modes, row.normals(t)), row.solve(modes, row.slopes(t))
        starts.append(t)
        pieces.append([(v0, v1, v2 / 2) for v0, v1, v2 in zip(v, a, jerk, strict=True)])
        t = row.next_time(t, pieces[-1], modes, since, end)
        v = [_quadratic(piece, t - starts[-1]) for piece in pieces[-1]]
        if len(starts) > 1000:
            raise ValueError(f"more than 1000 events; the last ones at t = {mp.nstr(t, 12)}")

    def velocity(time: Number) -> tuple[mpf, ...]:
        at = exact(time)
        if not 0 <= at <= end:
            raise ValueError(f"the motion is known from 0 to {mp.nstr(end, 12)}, not at {mp.nstr(at, 12)}")
        k = bisect_right(starts, at) - 1
        return tuple(_quadratic(piece, at - starts[k]) for piece in pieces[k])

    return Motion(tuple(events), velocity)


def four_flywheels(
    inertias: Sequence[Number] = (1, 2, 3, 4),
    speeds: Sequence[Number] = (1, 1.01, 1.02, 1.03),
    *,
    mu_static: Number = 0.2,
    mu_coulomb: Number = 0.1,
    dwell: Number = 0.1,
    normals: Sequence[Number] = (100, 60, 30),
    slope: Number = 3000,
    triangle: Triangle = (0.4, 0.5, 0.6),
    until: Number = 4,
) -> Motion:
    """Four flywheels rubbing on each other in a row, the first of them braked once: a `chain`.

    Units as for `two_flywheels`; normals: of the interfaces c12, c23, c34 [N].
    Source: Breedveld 2000, figs. 9 and 11.
    """
    start, peak, stop = map(exact, triangle)
    force = ((start, 0), (peak, exact(slope) * (peak - start)), (stop, 0))
    loads = [("brake", force), *((f"c{k}{k + 1}", normal) for k, normal in enumerate(normals, start=1))]
    contacts = [Contact(name, mu_static, mu_coulomb, dwell, normal) for name, normal in loads]
    return chain(inertias, speeds, contacts, until)


class _Law(NamedTuple):
    """A contact in exact numbers; the normal force as points."""

    mu_s: mpf
    mu_c: mpf
    tau: mpf
    times: list[mpf]
    forces: list[mpf]

    @classmethod
    def of(cls, contact: Contact) -> _Law:
        points = contact.normal if isinstance(contact.normal, list | tuple) else [(0, contact.normal)]
        times, forces = ([exact(x) for x in column] for column in zip(*points, strict=True))
        _require(min(forces) >= 0, f"the normal force of {contact.name} must not be negative")
        return cls(exact(contact.mu_static), exact(contact.mu_coulomb), exact(contact.dwell), times, forces)

    def slope(self, t: mpf) -> mpf:
        """Of the normal force, just after t."""
        k = bisect_right(self.times, t)
        if not 0 < k < len(self.times):
            return mp.zero
        return (self.forces[k] - self.forces[k - 1]) / (self.times[k] - self.times[k - 1])

    def normal(self, t: mpf) -> mpf:
        k = max(bisect_right(self.times, t) - 1, 0)
        return self.forces[k] + self.slope(t) * (t - self.times[k])

    def unrisen(self, rest: mpf) -> mpf:
        return _unrisen(self.mu_s, self.mu_c, self.tau, rest)


class _Row:
    """The wheels and contacts of a chain: forces, consistent modes, and the next thing to happen."""

    def __init__(self, inertias: list[mpf], laws: list[_Law]) -> None:
        self.inertias, self.laws = inertias, laws
        # Contact k stands left of wheel k. An interface has that wheel as body b and pushes it by +r; the
        # brake has it as body a and pushes it by -r.
        self.signs = [-1] + [1] * (len(laws) - 1)
        largest = max(law.mu_s * max(law.forces) for law in laws)
        self.tiny = _roundoff() * largest  # forces this small are roundoff

    def normals(self, t: mpf) -> list[mpf]:
        return [law.normal(t) for law in self.laws]

    def slopes(self, t: mpf) -> list[mpf]:
        return [law.slope(t) for law in self.laws]

    def relative(self, x: Sequence[mpf]) -> list[mpf]:
        """Relative velocities (accelerations) of the contacts from those of the wheels."""
        neighbours = zip(self.signs, [mp.zero, *x[:-1]], x, strict=True)
        return [sign * (left - right) for sign, left, right in neighbours]

    def groups(self, joined: Sequence[bool]) -> list[range]:
        """Runs of wheels that move as one."""
        heads = [k for k in range(len(joined)) if k == 0 or not joined[k]]
        return [range(i, j) for i, j in pairwise([*heads, len(joined)])]

    def join(self, v: list[mpf], joined: list[bool]) -> list[mpf]:
        """Velocities with the joined wheels equally fast: momentum is kept, and the ground stands still."""
        out = list(v)
        for group in self.groups(joined):
            grounded = group[0] == 0 and joined[0]
            if len(group) > 1 or grounded:
                momentum = sum(self.inertias[k] * v[k] for k in group)
                common = mp.zero if grounded else momentum / sum(self.inertias[k] for k in group)
                for k in group:
                    out[k] = common
        return out

    def solve(self, modes: list[int], normals: list[mpf]) -> tuple[list[mpf], list[mpf]]:
        """Friction forces and accelerations for these normal forces; linear, so rates give rates."""
        slipping = zip(self.signs, modes, self.laws, normals, strict=True)
        push = [sign * mode * law.mu_c * normal for sign, mode, law, normal in slipping] + [mp.zero]
        a = [mp.zero] * len(modes)
        for group in self.groups([mode == STUCK for mode in modes]):
            grounded = group[0] == 0 and modes[0] == STUCK
            outer = push[group[0]] - push[group[-1] + 1]
            common = mp.zero if grounded else outer / sum(self.inertias[k] for k in group)
            for k in reversed(group):
                a[k] = common
                if modes[k] == STUCK:
                    push[k] = push[k + 1] + self.inertias[k] * common
        return [sign * force for sign, force in zip(self.signs, push, strict=False)], a

    def _sign(self, *derivatives: mpf) -> int:
        """Sign, just after now, of a quantity with this value, rate, ... now."""
        return next((int(mp.sign(x)) for x in derivatives if abs(x) > self.tiny), 0)

    def settle(self, t: mpf, modes: list[int], zero: list[bool], since: list[mpf]) -> list[int]:
        """Consistent modes just after t: contacts at rest are tried stuck, the most overloaded go first."""
        normals, slopes = self.normals(t), self.slopes(t)
        trial = [STUCK if still else mode for mode, still in zip(modes, zero, strict=True)]
        for _ in range(10 * len(modes)):
            (r, a), (dr, da) = self.solve(trial, normals), self.solve(trial, slopes)
            overload: dict[int, mpf] = {}
            for k, law in enumerate(self.laws):
                unrisen = law.unrisen(t - since[k] if modes[k] == STUCK else mp.zero)
                limit = (law.mu_s - unrisen) * normals[k]
                rate = (law.mu_s - unrisen) * slopes[k] + (unrisen * normals[k] / law.tau if law.tau else 0)
                excess = self._sign(abs(r[k]) - limit, self._sign(r[k], dr[k]) * dr[k] - rate)
                if trial[k] == STUCK and excess > 0:
                    overload[k] = abs(r[k]) / limit if limit > self.tiny else mp.inf
            # A contact let go may, once others have gone too, turn out to be pushed against its own mode.
            starts = list(zip(self.relative(a), self.relative(da), strict=True))
            wrong = [k for k in range(len(trial)) if zero[k] and trial[k] * self._sign(*starts[k]) < 0]
            if overload:
                most = max(overload.values()) * (1 - _roundoff())  # ties go together
                for k, ratio in overload.items():
                    trial[k] = self._sign(r[k], dr[k]) if ratio >= most else STUCK
            elif wrong:
                for k in wrong:
                    trial[k] = STUCK
            else:
                return trial
        raise ValueError(f"no consistent modes at t = {mp.nstr(t, 12)}")

    def next_time(
        self, t: mpf, pieces: list[tuple[mpf, mpf, mpf]], modes: list[int], since: list[mpf], end: mpf
    ) -> mpf:
        """Time of the next event, kink of a normal force, or the end, whichever comes first."""
        horizon = min([x for law in self.laws for x in law.times if t < x < end], default=end)
        step, instant = horizon - t, _roundoff() * end
        normals, slopes = self.normals(t), self.slopes(t)
        (r, _), (dr, _) = self.solve(modes, normals), self.solve(modes, slopes)
        gaps = [self.relative(column) for column in zip(*pieces, strict=True)]
        for k, law in enumerate(self.laws):
            if modes[k] != STUCK:
                # A root closer than roundoff is the one the contact has just left.
                roots = _real_roots(*(gap[k] for gap in gaps))
                step = min([step, *(root for root in roots if root > instant)])
                continue
            unrisen = law.unrisen(t - since[k])
            decaying = (unrisen * normals[k], unrisen * slopes[k])
            for side in (-1, 1):
                line = (side * r[k] - law.mu_s * normals[k], side * dr[k] - law.mu_s * slopes[k])
                step = _first_rise(line, decaying, law.tau or mp.one, step)
        return t + step if t + step < horizon - instant else horizon


def _quadratic(coefficients: tuple[mpf, mpf, mpf], s: mpf) -> mpf:
    return coefficients[0] + s * (coefficients[1] + s * coefficients[2])


def _real_roots(c0: mpf, c1: mpf, c2: mpf) -> list[mpf]:
    """Roots s of c0 + c1 s + c2 s²."""
    if c2 == 0:
        return [-c0 / c1] if c1 else []
    discriminant = c1 * c1 - 4 * c2 * c0
    if discriminant < 0:
        return []
    q = -(c1 + (1 if c1 >= 0 else -1) * mp.sqrt(discriminant)) / 2  # no cancellation
    return [q / c2, c0 / q] if q else [mp.zero]


def _first_rise(p: tuple[mpf, mpf], q: tuple[mpf, mpf], tau: mpf, end: mpf) -> mpf:
    """First s in (0, end) at which f = p(s) + q(s) exp(-s/tau), p and q linear, becomes positive; else end.

    f'' has one zero at most, known in closed form. Between it and the ends f' is monotone, so its zeros can
    be bracketed, and between those f is monotone: no root is missed.
    """

    def f(s: mpf) -> mpf:
        return p[0] + p[1] * s + (q[0] + q[1] * s) * mp.exp(-s / tau)

    def slope(s: mpf) -> mpf:
        return p[1] + (q[1] - (q[0] + q[1] * s) / tau) * mp.exp(-s / tau)

    bend = 2 * tau - q[0] / q[1] if q[1] else mp.zero
    marks = [mp.zero, bend, end] if 0 < bend < end else [mp.zero, end]
    turns = [_root(slope, a, b) for a, b in pairwise(marks) if slope(a) * slope(b) < 0]
    for a, b in pairwise([mp.zero, *turns, end]):
        if f(a) <= 0 < f(b):
            return _root(f, a, b)
    return end


# One or two bodies


class StickPhase(NamedTuple):
    """Interface force [N] and common acceleration [m/s²] of two stuck bodies."""

    force: mpf
    acceleration: mpf


def stick_phase(force1: Number, force2: Number, inertia1: Number, inertia2: Number) -> StickPhase:
    """Two bodies stuck to each other: the force between them and their acceleration.

    lambda = (F1 m2 - F2 m1)/(m1 + m2), the force on 1 being -lambda and on 2 +lambda, and
    a = (F1 + F2)/(m1 + m2). An infinite inertia is the ground: lambda = F1 (or -F2), a = 0.

    force1, force2: all other forces on each body [N]; inertia1, inertia2 [kg], one may be `mp.inf`.
    Source: Breedveld 2000, eqs. (1), (2) and (7).
    """
    f1, f2, m1, m2 = map(exact, (force1, force2, inertia1, inertia2))
    if mp.isinf(m1) and mp.isinf(m2):
        raise ValueError("of two bodies of infinite inertia nothing says what force joins them")
    if mp.isinf(m2):
        return StickPhase(f1, mp.zero)
    if mp.isinf(m1):
        return StickPhase(-f2, mp.zero)
    return StickPhase((f1 * m2 - f2 * m1) / (m1 + m2), (f1 + f2) / (m1 + m2))


class LockUp(NamedTuple):
    """Time until two bodies lock [s], and the heat made on the way [J]."""

    time: mpf
    heat: mpf


def lock_up(inertia1: Number, inertia2: Number, relative_velocity: Number, friction: Number) -> LockUp:
    """Two free bodies rub until they are equally fast.

    With the reduced inertia m = m1 m2/(m1 + m2): t = m |w0|/F and heat = m w0²/2, whatever F.

    inertia1, inertia2 [kg], relative_velocity: w0 [m/s], friction: constant force F [N].
    Source: momentum and energy of the relative motion, m w' = -F sign(w).
    """
    m1, m2, w0, force = map(exact, (inertia1, inertia2, relative_velocity, friction))
    reduced = m1 * m2 / (m1 + m2)
    return LockUp(reduced * abs(w0) / force, reduced * w0**2 / 2)


def viscous_relaxation(
    inertia1: Number, inertia2: Number, relative_velocity: Number, damping: Number, time: Number
) -> mpf:
    """Relative velocity [m/s] of two free bodies with viscous friction between them: it never reaches zero.

    w(t) = w0 exp(-c t (1/m1 + 1/m2)).

    inertia1, inertia2 [kg], relative_velocity: w0 [m/s], damping: c [N s/m], time [s].
    Source: m w' = -c w with the reduced inertia m = m1 m2/(m1 + m2).
    """
    m1, m2, w0, c, t = map(exact, (inertia1, inertia2, relative_velocity, damping, time))
    return w0 * mp.exp(-c * t * (1 / m1 + 1 / m2))


@dataclass(frozen=True)
class PulledBlock:
    """Steady stick-slip: when the block first breaks loose, how long it then slips and sticks [s]."""

    first_break: mpf
    slip_time: mpf
    stick_time: mpf
    speed: mpf
    omega: mpf
    drop: mpf  # spring extension lost from breakaway to the Coulomb level [m]
    sliding: mpf  # spring extension at the Coulomb level [m]

    def events(self, until: Number, contact: str = "floor") -> tuple[Event, ...]:
        """All changes of mode up to a time [s]."""
        out, t, end = [], self.first_break, exact(until)
        while t <= end:
            out += [Event(t, contact, STUCK, FORWARD), Event(t + self.slip_time, contact, FORWARD, STUCK)]
            t += self.slip_time + self.stick_time
        return tuple(event for event in out if event.time <= end)

    def state(self, time: Number) -> tuple[mpf, mpf]:
        """Position [m] and velocity [m/s] of the block at a time [s]."""
        t = exact(time)
        if t <= self.first_break:
            return mp.zero, mp.zero
        s = (t - self.first_break) % (self.slip_time + self.stick_time)
        rest = max(s - self.slip_time, mp.zero)  # stuck for so long, where the slip left it
        swing = self.omega * (s - rest)
        extension = self.sliding + self.drop * mp.cos(swing) + self.speed / self.omega * mp.sin(swing)
        velocity = self.speed * (1 - mp.cos(swing)) + self.drop * self.omega * mp.sin(swing)
        return self.speed * (t - rest) - extension, mp.zero if rest else velocity


def pulled_block(
    mass: Number, stiffness: Number, speed: Number, *, normal: Number, mu_static: Number, mu_coulomb: Number
) -> PulledBlock:
    """A block on the floor, at rest with a relaxed spring whose far end starts to move at constant speed.

    It breaks at mu_s N/(k v), slips for (2/omega)(pi - atan(dF omega/(k v))) and sticks for 2 dF/(k v), again
    and again; dF = (mu_s - mu_c) N, omega = sqrt(k/m). At a time s after a break its velocity is
    v (1 - cos(omega s)) + (dF omega/k) sin(omega s). No dwell.

    mass [kg], stiffness [N/m], speed [m/s], normal [N], mu_static > mu_coulomb [-].
    Source: M. Wangen, Physical Principles of Sedimentary Basin Analysis, Cambridge 2010, eqs. (8.12)-(8.14).
    """
    m, k, v, load, mu_s, mu_c = map(exact, (mass, stiffness, speed, normal, mu_static, mu_coulomb))
    _require(
        min(m, k, v, load) > 0 and mu_s > mu_c >= 0, "all must be positive, and mu_static above mu_coulomb"
    )
    omega, drop = mp.sqrt(k / m), (mu_s - mu_c) * load / k
    slip_time = 2 / omega * (mp.pi - mp.atan(drop * omega / v))
    return PulledBlock(mu_s * load / (k * v), slip_time, 2 * drop / v, v, omega, drop, mu_c * load / k)


@dataclass(frozen=True)
class CoulombDecay:
    """Turning points (time [s], position [m]) of a decaying oscillation, from the start to where it stays."""

    turns: tuple[tuple[mpf, mpf], ...]
    omega: mpf
    offset: mpf  # friction over stiffness [m]: a half swing is centred this far out, on the side it starts

    def state(self, time: Number) -> tuple[mpf, mpf]:
        """Position [m] and velocity [m/s] at a time [s]."""
        t = exact(time)
        n = int(mp.floor(t * self.omega / mp.pi))
        if n >= len(self.turns) - 1:
            return self.turns[-1][1], mp.zero
        start, x = self.turns[n]
        centre, phase = mp.sign(x) * self.offset, self.omega * (t - start)
        return centre + (x - centre) * mp.cos(phase), (centre - x) * self.omega * mp.sin(phase)


def coulomb_decay(
    mass: Number, stiffness: Number, friction: Number, displacement: Number, breakaway: Number | None = None
) -> CoulombDecay:
    """A mass on a spring, let go at rest on a floor with dry friction: it turns a few times, then stays.

    At t = n pi/omega it turns at (-1)^n (x0 - 2 n F/k) (for x0 > 0), and stays at the first turn with
    k |x| <= F_s; omega = sqrt(k/m).

    mass [kg], stiffness: k [N/m], friction: F while it slips [N], displacement: x0 [m], breakaway: F_s, the
    force at which the stuck mass breaks loose [N], F where it is not given.
    Source: m x'' + k x = -F sign(x') is half a cosine about -F sign(x')/k between two turns; J. Woodhouse,
    Euphonics, section 8.2.3.
    """
    m, k, force, x0 = map(exact, (mass, stiffness, friction, displacement))
    level = force if breakaway is None else exact(breakaway)
    _require(min(m, k, force) > 0 and level >= force, "friction must be positive, and breakaway no less")
    omega = mp.sqrt(k / m)
    # A turn exactly on the level stays: roundoff must not add another.
    last = max(int(mp.ceil((k * abs(x0) - level) / (2 * force) - _roundoff())), 0)
    turns = tuple(
        (n * mp.pi / omega, (-1) ** n * mp.sign(x0) * (abs(x0) - 2 * n * force / k)) for n in range(last + 1)
    )
    return CoulombDecay(turns, omega, force / k)


@dataclass(frozen=True)
class DenHartog:
    """Steady forced motion under P cos(frequency t + phase): at t = 0 it turns at +amplitude [m], at rest."""

    amplitude: mpf
    phase: mpf  # [rad]
    beta: mpf  # frequency over natural frequency
    damping: mpf  # U
    offset: mpf  # friction over stiffness [m]
    frequency: mpf

    def state(self, time: Number) -> tuple[mpf, mpf]:
        """Position [m] and velocity [m/s] at a time [s]; (amplitude, 0) at t = 0."""
        half, angle = divmod(self.frequency * exact(time), mp.pi)
        sign, slow = (-1) ** int(mp.nint(half)), angle / self.beta
        x = self.amplitude * mp.cos(angle) + self.offset * (
            1 - mp.cos(slow) + self.damping * (mp.sin(angle) - self.beta * mp.sin(slow))
        )
        rate = -self.amplitude * mp.sin(angle) + self.offset * (
            mp.sin(slow) / self.beta + self.damping * (mp.cos(angle) - mp.cos(slow))
        )
        return sign * x, sign * self.frequency * rate


def _den_hartog_functions(beta: mpf) -> tuple[mpf, mpf]:
    """V and U; both grow without bound at beta = 1, and U at 1/3, 1/5, ... too."""
    _require(beta > 0 and (mp.one / beta) % 2 != 1, "beta must be positive, and neither 1 nor 1/3, 1/5, ...")
    return 1 / (1 - beta**2), mp.sin(mp.pi / beta) / (beta * (1 + mp.cos(mp.pi / beta)))


def den_hartog_limit(beta: Number) -> mpf:
    """Largest ratio F/P of friction to exciting force for which the steady forced motion has no stops.

    F/P = |V|/sqrt(U² + (S/beta²)²), where S is the largest value over 0 < a < pi of
    (beta sin(a/beta) + U beta² (cos a - cos(a/beta)))/sin a: below it the velocity keeps its sign from turn
    to turn. S is 1, the value at both ends, unless a peak between them is higher (at low beta).

    beta: exciting over natural frequency [-].
    Source: Den Hartog, Phil. Mag. 9 (1930) 801; Marino and Cicirello, Nonlinear Dynamics 99 (2020) 1781,
    eqs. (6)-(9).
    """
    b = exact(beta)
    v, u = _den_hartog_functions(b)

    def ratio(a: mpf) -> mpf:
        return (b * mp.sin(a / b) + u * b**2 * (mp.cos(a) - mp.cos(a / b))) / mp.sin(a)

    def slope(a: mpf) -> mpf:  # of the ratio, times sin² a
        rate = mp.cos(a / b) - u * b**2 * mp.sin(a) + u * b * mp.sin(a / b)
        return rate * mp.sin(a) - ratio(a) * mp.sin(a) * mp.cos(a)

    # The fastest term turns every b pi: twenty points to each see every extremum.
    count = int(mp.ceil(20 / b)) + 20
    grid = [mp.pi * n / count for n in range(1, count)]
    peaks = [_root(slope, a, c) for a, c in pairwise(grid) if slope(a) > 0 > slope(c)]
    largest = max([mp.one, *map(ratio, peaks)])
    return abs(v) / mp.sqrt(u**2 + (largest / b**2) ** 2)


def den_hartog(
    frequency: Number, friction: Number, mass: Number = 1, stiffness: Number = 1, force: Number = 1
) -> DenHartog:
    """A mass on a spring with dry friction, forced by P cos(omega t + phase): steady motion without stops.

    k x0/P = sqrt(V² - r² U²), r = F/P, beta = omega sqrt(m/k), V = 1/(1 - beta²),
    U = sin(pi/beta)/(beta (1 + cos(pi/beta))); sin(phase) = -r U/V, cos(phase) = k x0/(P V). Holding the mass
    at a turn would take beta² k x0, so the breakaway level may be as high as that. Motion with stops (see
    `den_hartog_limit`) raises ValueError.

    frequency: omega [rad/s], friction: F [N], mass: m [kg], stiffness: k [N/m], force: P [N]. With the last
    three left at 1, frequency is beta and friction is r.
    Source: Den Hartog, Phil. Mag. 9 (1930) 801.
    """
    omega, f, m, k, p = map(exact, (frequency, friction, mass, stiffness, force))
    beta, r = omega * mp.sqrt(m / k), f / p
    v, u = _den_hartog_functions(beta)
    _require(0 <= r <= den_hartog_limit(beta), "the motion has stops, friction must be smaller")
    x0 = mp.sqrt(v**2 - (r * u) ** 2)
    return DenHartog(x0 * p / k, mp.atan2(-r * u / v, x0 / v), beta, u, f / k, omega)
