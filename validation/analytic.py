"""Exact answers for dry friction, to check simulations against.

Nothing here imports the package or integrates a differential equation: between two events the motion is a
closed form, and events are roots of closed forms. All numbers are mpmath's, with 40 digits; `mp.dps` of this
module changes that. Units are SI and read the same for rotation: kg as kg m², N as N m, m/s as rad/s.

Modes are -1 (backward), 0 (stuck) and +1 (forward): the sign of the relative velocity w = v_a - v_b of a
contact between a and b. Its friction force r opposes w > 0: the force on a is -r, on b it is +r.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple, TypeAlias

import mpmath
from mpmath import mpf

mp = mpmath.mp.clone()  # a context of our own: the precision set elsewhere is neither used nor changed
mp.dps = 40

Number: TypeAlias = int | float | str | Fraction | mpf

BACKWARD, STUCK, FORWARD = -1, 0, 1


def exact(x: Number) -> mpf:
    """Return a number as it was meant: a float stands for the decimal it prints as, so 1.01 is 101/100."""
    return mp.convert(repr(float(x)) if isinstance(x, float) else x)


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


def two_flywheels() -> Motion:
    """Two flywheels, an interface between them and a brake on the first: the benchmark, phase by phase.

    m1 v1' = -r_i - r_b, m2 v2' = r_i, with |r| = mu_c N where a contact slips, and a stuck contact breaks at
    (mu_s - (mu_s - mu_c) exp(-(t - t_start)/dwell)) N. The story is: the interface locks; it holds through
    the first triangle of the brake; on the rising side of the second it breaks; on the falling side wheel 1
    stops and is dragged off again; after the brake the wheels lock.

    Source: Breedveld 2000, section 3, table 1, eqs. (1), (8), (9).
    """
    m1, m2, v10, v20 = map(exact, (1, 10, 1, 1.01))
    mu_s, mu_c, tau, load, rise = map(exact, (0.2, 0.1, 0.1, 100, 3000))  # rise: of the brake's force [N/s]
    first, second = (tuple(map(exact, triangle)) for triangle in ((0.05, 0.10, 0.15), (0.4, 0.5, 0.6)))
    total, grip = m1 + m2, mu_c * load  # grip: the force of the slipping interface
    kinks = [kink for start, peak, stop in (first, second) for kink in ((start, rise), (peak, -2 * rise), (stop, rise))]

    def brake(t: mpf) -> mpf:  # normal force of the brake
        return sum(change * max(t - kink, 0) for kink, change in kinks)

    def impulse(t: mpf) -> mpf:  # of the brake slipping forward, since 0
        return mu_c * sum(change * max(t - kink, 0) ** 2 for kink, change in kinks) / 2

    def unrisen(rest: mpf) -> mpf:  # what the dwell still withholds of mu_s after a time of rest, eq. (9)
        return (mu_s - mu_c) * mp.exp(-rest / tau)

    # The interface slips until the wheels are equally fast. It holds through the first triangle, for at its
    # peak the load on it is below its limit.
    lock = (v20 - v10) / (grip * (1 / m1 + 1 / m2))
    common = (m1 * v10 + m2 * v20) / total

    # Then ramp s = (mu_s - u exp(-s/tau)) N at s = slip - start, where the interface passes on a share of the
    # brake's force, eq. (1). The left side less the right is convex and negative at s = 0, so the root is the
    # larger of two: the principal branch of Lambert's W.
    ramp = m2 / total * mu_c * rise
    after = mu_s * load / ramp
    withheld = unrisen(second[0] - lock) * load / (ramp * tau)
    slip = second[0] + after + tau * mp.lambertw(-withheld * mp.exp(-after / tau))
    joint = common - impulse(slip) / total

    def dragged(t: mpf, since: mpf) -> mpf:  # gain of wheel 1 while interface and brake slip
        return (grip * (t - since) - impulse(t) + impulse(since)) / m1

    # Wheel 1 stops at the first root of a quadratic in the time since the peak.
    at_peak = joint + dragged(second[1], slip)
    slowing = (mu_c * brake(second[1]) - grip) / m1
    stop = second[1] + 2 * at_peak / (slowing + mp.sqrt(slowing**2 - 2 * at_peak * mu_c * rise / m1))

    # The brake, loaded by grip, breaks when its limit has come down to it. The limit lies between mu_c N_b
    # and mu_s N_b, and (mu_s - u) - grip/N_b is concave and positive at first: one root between these times.
    early, late = (second[2] - grip / mu / rise for mu in (mu_c, mu_s))
    drag = mp.findroot(
        lambda t: grip - (mu_s - unrisen(t - stop)) * brake(t),
        (early, late),
        solver="anderson",
        maxsteps=1000,
    )

    # Without the brake both velocities are straight lines, which meet.
    gap = joint - grip * (second[2] - slip) / m2 - dragged(second[2], drag)
    relock = second[2] + gap / (grip * (1 / m1 + 1 / m2))
    final = joint - grip * (relock - slip) / m2

    def velocity(time: Number) -> tuple[mpf, mpf]:
        t = exact(time)
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
    omega = mp.sqrt(k / m)
    # A turn exactly on the level stays: roundoff must not add another.
    last = max(int(mp.ceil((k * abs(x0) - level) / (2 * force) - mp.mpf("1e-30"))), 0)
    turns = tuple((n * mp.pi / omega, (-1) ** n * mp.sign(x0) * (abs(x0) - 2 * n * force / k)) for n in range(last + 1))
    return CoulombDecay(turns, omega, force / k)


@dataclass(frozen=True)
class DenHartog:
    """Steady forced motion: at t = 0 it turns at +amplitude [m], at rest."""

    beta: mpf  # frequency over natural frequency
    friction: mpf  # over the exciting force
    amplitude: mpf
    phase: mpf  # of the exciting force [rad]
    damping: mpf  # U

    def state(self, time: Number) -> tuple[mpf, mpf]:
        """Position [m] and velocity [m/s] at a time [s]; (amplitude, 0) at t = 0."""
        half, angle = divmod(self.beta * exact(time), mp.pi)
        sign, slow = (-1) ** int(mp.nint(half)), angle / self.beta
        x = self.amplitude * mp.cos(angle) + self.friction * (
            1 - mp.cos(slow) + self.damping * (mp.sin(angle) - self.beta * mp.sin(slow))
        )
        rate = -self.amplitude * mp.sin(angle) + self.friction * (
            mp.sin(slow) / self.beta + self.damping * (mp.cos(angle) - mp.cos(slow))
        )
        return sign * x, sign * self.beta * rate


def den_hartog(beta: Number, friction: Number) -> DenHartog:
    """A mass of 1 kg on a spring of 1 N/m with dry friction r, forced by cos(beta t + phase): without stops.

    x0 = sqrt(V² - r² U²), V = 1/(1 - beta²), U = sin(pi/beta)/(beta (1 + cos(pi/beta))); sin(phase) = -r U/V,
    cos(phase) = x0/V. Holding the mass at a turn would take beta² x0, so the breakaway level may be as high as
    that. With more friction than this motion allows its velocity would change sign between the turns.

    beta: exciting frequency [rad/s], neither 1 nor 1/3, 1/5, ...; friction: r [N].
    Source: Den Hartog, Phil. Mag. 9 (1930) 801.
    """
    b, r = exact(beta), exact(friction)
    v, u = 1 / (1 - b**2), mp.sin(mp.pi / b) / (b * (1 + mp.cos(mp.pi / b)))
    x0 = mp.sqrt(v**2 - (r * u) ** 2)
    return DenHartog(b, r, x0, mp.atan2(-r * u / v, x0 / v), u)
