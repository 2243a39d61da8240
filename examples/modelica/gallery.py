"""Examples of the Modelica Standard Library as scenes, beside exact answers where they are known.

Each function returns one scene, with the numbers of the library's example of that name. `CASES` says how long it runs,
what is drawn, and what is known: exact times of events of a row, or exact values at the end. The library's own results
come from a solver with tolerance 1e-6, and differ from these by 1e-8 to 1e-3.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    DryFriction,
    Force,
    Gap,
    Gear,
    OneWay,
    Planetary,
    Result,
    Scene,
    Spring,
    Stop,
    Tie,
    feedback,
    output,
    piecewise_linear,
    simulate,
    sine,
    step,
    velocity,
)

FIGURE = Path(__file__).parents[1] / "figures" / "modelica.png"


def friction() -> Scene:
    """Translational.Friction: a mass between two hard stops, on a spring, with a Stribeck curve: 3 + 5 exp(-2 |v|)."""
    stribeck = DryFriction(mu_static=8.0, mu_coulomb=3.0, stribeck_velocity=0.5, stribeck_exponent=1.0)
    return Scene(
        Body("mass", inertia=1.0, velocity=-5.0),
        Stop("ends", "mass", GROUND, lower=-0.4, upper=0.4),
        Contact("guide", "mass", GROUND, stribeck, normal=1.0),
        Damper("mass", GROUND, damping=1.0),
        Spring("mass", GROUND, stiffness=500.0, rest=-0.25),
        motion="translation",
    )


def brake() -> Scene:
    """Translational.Brake: a mass of 1 kg at 1 m/s is braked with 2 N from 0.1 s on."""
    return Scene(
        Body("mass", inertia=1.0, velocity=1.0),
        Contact("brake", "mass", GROUND, DryFriction(1.0, 1.0), normal=step(0.1, 0.0, 2.0)),
        motion="translation",
    )


def elasto_gap() -> Scene:
    """Translational.ElastoGap: a mass starts 1.5 m beyond the upper limit of a damped gap."""
    return Scene(
        Body("mass", inertia=1.0, position=2.0),
        Gap("gap", "mass", GROUND, lower=-0.5, upper=0.5, stiffness=10.0, damping=1.5),
        motion="translation",
    )


def first() -> Scene:
    """Rotational.First: a motor, an ideal gear, a damper, a spring and a load."""
    return Scene(
        Body("motor", inertia=0.1),
        Body("shaft", inertia=2.0),
        Body("load", inertia=2.0),
        Gear("gear", "motor", "shaft", ratio=10.0),
        Damper("shaft", GROUND, damping=10.0),
        Spring("shaft", "load", stiffness=1e4),
        Force("motor", sine(10.0, frequency=5.0)),
        motion="rotation",
    )


def coupled_clutches() -> Scene:
    """Rotational.CoupledClutches: three clutches close one after another."""
    lining = DryFriction(mu_static=0.55, mu_coulomb=0.5)
    return Scene(
        Body("J1", inertia=1.0, velocity=10.0),
        *(Body(name, inertia=1.0) for name in ("J2", "J3", "J4")),
        Force("J1", sine(10.0, frequency=5.0)),
        Contact("clutch1", "J1", "J2", lining, normal=sine(20.0, frequency=0.2, phase=math.pi / 2)),
        Contact("clutch2", "J2", "J3", lining, normal=step(0.4, 0.0, 20.0)),
        Contact("clutch3", "J3", "J4", lining, normal=step(0.9, 0.0, 20.0)),
        motion="rotation",
    )


def backlash() -> Scene:
    """Rotational.Backlash: one inertia on a spring and damper, and one that has a play of 45 degrees to them."""
    half = math.radians(45.0) / 2
    return Scene(
        Body("without", inertia=5.0, position=math.pi / 2),
        Spring("without", GROUND, stiffness=20e3, damping=50.0),
        Body("with", inertia=5.0, position=math.pi / 2),
        Gap("play", "with", GROUND, lower=-half, upper=half, stiffness=20e3, damping=50.0),
        motion="rotation",
    )


def one_way_clutch() -> Scene:
    """Rotational.OneWayClutch: a freewheel parallel to a dry clutch that is pressed twice."""
    pressed = piecewise_linear([0.3, 0.3, 0.95, 0.95, 1.6, 1.6], [0, 3, 3, 0, 0, 3])
    return Scene(
        Body("in", inertia=1.0, velocity=-0.5),
        Body("out", inertia=1.0),
        OneWay("free", "in", "out"),
        Contact("clutch", "in", "out", DryFriction(12.5, 0.5), normal=pressed),
        Force("in", sine(10.0, frequency=3.0)),
        motion="rotation",
    )


def one_way_clutch_disengaged() -> Scene:
    """Rotational.OneWayClutchDisengaged: the freewheel alone, against a load."""
    return Scene(
        Body("in", inertia=1.0, velocity=-0.5),
        Body("out", inertia=1.0),
        OneWay("free", "in", "out"),
        Force("in", sine(10.0, frequency=2.0, offset=0.3)),
        Force("out", -0.3),
        motion="rotation",
    )


def elastic_bearing() -> Scene:
    """Rotational.ElasticBearing: a gear whose housing stands on a spring; its output shaft has no inertia."""
    return Scene(
        Body("shaft", inertia=1.0),
        Body("out", inertia=0.0),
        Body("load", inertia=50.0),
        Body("housing", inertia=5.0),
        # seen from the housing the shaft turns three times as fast as the output
        Tie("gear", {"shaft": 1.0, "out": -3.0, "housing": 2.0}),
        Spring("out", "load", stiffness=1e3),
        Spring("housing", GROUND, stiffness=1e5, damping=5.0),
        Force("shaft", piecewise_linear([0.0, 5.0], [0.0, 100.0])),
        motion="rotation",
    )


def simple_gear_shift() -> Scene:
    """Rotational.SimpleGearShift: a planetary gear shifts as its brake opens and its clutch closes within 0.1 s."""
    lining = DryFriction(mu_static=100.0, mu_coulomb=100.0)
    shift = piecewise_linear([2.0, 2.1], [0.0, 1.0])
    # the load takes its 20 N m at 100 revolutions per minute
    load = feedback(lambda w: -20.0 * (w / RATED) ** 2, velocity("carrier"))
    return Scene(
        Body("sun", inertia=1.0),
        Body("carrier", inertia=10.0),
        Body("ring", inertia=0.0),
        Planetary("gear", sun="sun", carrier="carrier", ring="ring", ratio=1.5),
        Contact("clutch", "sun", "ring", lining, normal=shift),
        Contact("brake", "ring", GROUND, lining, normal=1.0 - shift),
        Force("sun", step(0.5, 0.0, 20.0)),
        Force("carrier", load),
        motion="rotation",
    )


class Case(NamedTuple):
    """A scene, how long it runs, what is drawn of it, and what is known of it exactly."""

    scene: Callable[[], Scene]
    stop: float
    drawn: tuple[str, ...]
    row: str = ""
    times: tuple[float, ...] = ()
    end: tuple[tuple[str, str, float], ...] = ()


ELASTO_GAP = (0.583372882547, 0.875160816924, 1.896201370487, 2.404066200137, 3.425106753700, 4.309059291854)
ONE_WAY = (0.0802800002413492, 1 / 6, 0.430677395670009, 0.95, 1.05, 7 / 6, 1.756204447415)
# the clutch lets go where 5 sin(4 pi t) + 0.3 comes to 0
LETS_GO = (math.pi + math.asin(0.06)) / (4 * math.pi)
DAMPED = math.sqrt(20e3 / 5 - 25.0)
RATED = 100.0 * 2 * math.pi / 60
SWINGS = math.pi / 2 * math.exp(-5.0) * (math.cos(DAMPED) + 5.0 / DAMPED * math.sin(DAMPED))

CASES = {
    "Friction": Case(friction, 1.0, ("position mass",)),
    "Brake": Case(brake, 1.0, ("velocity mass",), "brake", (0.6,), (("position", "mass", 0.35),)),
    "ElastoGap": Case(
        elasto_gap, 5.0, ("position mass",), "gap", ELASTO_GAP, (("position", "mass", -0.7078852940798114),)
    ),
    "First": Case(
        first,
        1.0,
        ("velocity load",),
        end=(("position", "load", 0.1628616428799686), ("velocity", "load", -0.1381452799183233)),
    ),
    "CoupledClutches": Case(coupled_clutches, 1.5, tuple(f"velocity J{k}" for k in range(1, 5))),
    "Backlash": Case(backlash, 1.0, ("position without", "position with"), end=(("position", "without", SWINGS),)),
    "OneWayClutch": Case(
        one_way_clutch,
        2.0,
        ("velocity in", "velocity out"),
        "free",
        ONE_WAY,
        (("velocity", "in", -0.25), ("position", "in", -0.2123499945496375)),
    ),
    "OneWayClutchDisengaged": Case(one_way_clutch_disengaged, 2.0, ("velocity in", "velocity out"), "free", (LETS_GO,)),
    "ElasticBearing": Case(elastic_bearing, 10.0, ("velocity shaft", "velocity load", "velocity housing")),
    "SimpleGearShift": Case(
        simple_gear_shift,
        5.0,
        ("velocity sun", "velocity carrier", "velocity ring"),
        "clutch",
        (2.110790361305612,),
        (("velocity", "carrier", 8.09003503997447),),
    ),
}


def errors(case: Case, result: Result) -> list[float]:
    """Return by how much a result is off from what is known."""
    found = [event.t for event in result.events if event.contact == case.row]
    off = [min((abs(t - one) for one in found), default=math.inf) for t in case.times]
    return off + [abs(getattr(result, what)(name)[-1] - value) for what, name, value in case.end]


def main(figure: Path) -> None:
    """Run all cases, print how far they are from what is known, and draw a page."""
    from stickslip.plots import Figure

    page = Figure(figsize=(8.0, 10.0), layout="constrained")
    for ax, (name, case) in zip(page.subplots(5, 2).flat, CASES.items(), strict=True):
        result = simulate(case.scene(), (0.0, case.stop))
        off = errors(case, result)
        known = f"{len(off)} exact values, worst error {max(off):.1e}" if off else "no exact answer known"
        balance = f"energy balances to {result.energy().relative_error:.1e}"
        print(f"{name}: {len(result.events)} events, {result.stats['engine']}; {known}; {balance}")
        for line, drawn in zip(("k-", "k--", "k:", "k-."), case.drawn, strict=False):
            what, body = drawn.split()
            ax.plot(result.t, getattr(result, what)(body), line, linewidth=1.2, label=body)
        for t in {event.t for event in result.events}:
            ax.axvline(t, color="0.8", linewidth=0.6, zorder=0)
        bodies = [drawn.split()[1] for drawn in case.drawn]
        ax.set_title(name if len(bodies) > 1 else f"{name}: {bodies[0]}", fontsize="medium")
        ax.set_xlabel("time [s]", fontsize="small")
        unit = output.column_units(result)[case.drawn[0]]
        ax.set_ylabel(f"{case.drawn[0].split()[0]} [{unit}]", fontsize="small")
        ax.tick_params(labelsize="small")
        if len(bodies) > 1:
            ax.legend(fontsize="x-small")
    page.savefig(figure, dpi=85)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURE)
