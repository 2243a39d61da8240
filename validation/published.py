"""Rows against results that others have published, computed with other programs or other methods."""

from __future__ import annotations

import math
from functools import partial

from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    LuGre,
    Result,
    Scene,
    Spring,
    simulate,
    sine,
    step,
)
from validation.exact import INTEGRATED, TIGHT
from validation.rows import FORMULATIONS, Answer, Row, asked, changes, event_error, require, worst

published_row = partial(Row, "Published results")


def coupled_clutches() -> Scene:
    """Four shafts in a row, a torque of 5 Hz on the first, three clutches that close one after another."""
    law = DryFriction(mu_static=0.55, mu_coulomb=0.5)
    return Scene(
        *(Body(f"J{i}", inertia=1.0, velocity=10.0 if i == 1 else 0.0) for i in (1, 2, 3, 4)),
        Force("J1", sine(10.0, 5.0)),
        Contact("clutch1", "J1", "J2", law, normal=sine(20.0, 0.2, phase=math.pi / 2)),
        Contact("clutch2", "J2", "J3", law, normal=20.0 * step(0.4)),
        Contact("clutch3", "J3", "J4", law, normal=20.0 * step(0.9)),
    )


CLUTCH_EVENTS = [
    (0.7096214746937467, "clutch2", 1, 0),
    (0.791662359154816, "clutch1", 1, 0),
    (0.8311085061376532, "clutch1", 0, 1),
    (0.9068501927978797, "clutch1", 1, 0),
    (1.000295859894639, "clutch1", 0, 1),
    (1.143967492473166, "clutch3", 1, 0),
]
CLUTCH_SPEEDS = (3.2470582724188, 2.4631871666496, 2.4631871666496, 2.4631871666496)


def clutches(formulation: str) -> Answer:
    """Events and final speeds."""
    result = simulate(coupled_clutches(), (0.0, 1.5), **asked(formulation), **TIGHT)
    times = event_error(changes(result), CLUTCH_EVENTS, 1.5)
    speeds = worst([result.velocity(f"J{i}")[-1] for i in (1, 2, 3, 4)], CLUTCH_SPEEDS)
    return max(times, speeds), f"6 events, times {times:.1e}, speeds {speeds:.1e}"


def lugre_block() -> Scene:
    """A block on bristles, pulled by a spring at 0.1 m/s."""
    law = DryFriction(1.5, 1.0, stribeck_velocity=0.001)
    return Scene(
        Body("block", inertia=1.0),
        Drive("hand", velocity=0.1),
        Spring("block", "hand", stiffness=2.0),
        Contact("floor", "block", GROUND, LuGre(law, 1e5, math.sqrt(1e5), 0.4), normal=1.0),
    )


# Position, velocity and bristle deflection at 25 s.
LUGRE_END = (1.908839199226505, 9.42415459e-6, 1.18167955e-5)


def lugre() -> Answer:
    """Position, velocity and deflection, each over its largest value in stick-slip (1.9 m, 0.35 m/s, 1.5e-5 m)."""
    result = simulate(lugre_block(), (0.0, 25.0), rtol=1e-10, atol=1e-14, t_eval=[25.0])
    end = (result.position("block")[0], result.velocity("block")[0], result.y[-1, 0])
    scales = (1.9, 0.35, 1.5e-5)
    errors = [abs(a - b) / s for a, b, s in zip(end, LUGRE_END, scales, strict=True)]
    return max(errors), "x = {:.12g} m, v = {:.9g} m/s, z = {:.9g} m".format(*end)


def belt(speed: float = 0.2, damping: float = 0.0) -> Scene:
    """A block on a running belt, held by a spring: friction falls with speed, so it sticks and slips."""
    law = DryFriction(1.0, 1.0, kinetic=lambda v: 1.0 / (1.0 + 3.0 * abs(v)))
    return Scene(
        Body("block", inertia=1.0, velocity=speed),
        Drive("belt", velocity=speed),
        Spring("block", GROUND, stiffness=1.0, damping=damping),
        Contact("rub", "block", "belt", law, normal=1.0),
    )


# Duration of slip and of stick, and period, in s; largest position in m.
BELT_CYCLE = (4.29599952548016, 7.70503176935042, 12.0010312948306, 1.13394467644166)


def belt_cycle(formulation: str) -> Answer:
    """The limit cycle, reached at the first breakaway."""
    result = simulate(belt(), (0.0, 42.0), **asked(formulation), **TIGHT)
    events = changes(result)
    require([e[2:] for e in events] == [(0, -1), (-1, 0)] * 3 + [(0, -1)], f"events {events}")
    t = [e[0] for e in events]
    cycles = [(t[i + 1] - t[i], t[i + 2] - t[i + 1], t[i + 2] - t[i], _highest(result, t[i])) for i in (0, 2, 4)]
    return worst(cycles, [BELT_CYCLE] * 3, 1.0), "slip {:.12g} s, stick {:.12g} s".format(*cycles[-1])


def _highest(result: Result, start: float) -> float:
    """Return the largest position within a second of breakaway: where the velocity passes 0."""
    turn = brentq(lambda t: float(result(t)[0]), start + 1e-6, start + 2.0, xtol=1e-14)
    return float(result(turn)[1])


ROWS = [
    *(
        published_row(
            f"coupled-clutches/{f}",
            f"three clutches close on four shafts: event times over 1.5 s, final speeds over the largest ({f})",
            "Modelica Standard Library, Rotational.Examples.CoupledClutches; exact times by quadrature",
            partial(clutches, f),
            INTEGRATED,
        )
        for f in FORMULATIONS
    ),
    published_row(
        "lugre",
        "stick-slip of a block on bristles: position, velocity and deflection at 25 s",
        "Exudyn, test of the LuGre friction model (Canudas de Wit et al. 1995)",
        lugre,
        1e-6,
    ),
    *(
        published_row(
            f"leine-belt/{f}",
            f"stick-slip on a belt: slip and stick times, period [s], largest position [m], three cycles ({f})",
            "Leine, Van Campen, De Kraker and Van den Steen 1998, recomputed to 15 digits",
            partial(belt_cycle, f),
            INTEGRATED,
        )
        for f in FORMULATIONS
    ),
]
