"""Families of random machines as plain data, each from a seed: see `validation.machine_oracle`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from validation.oracle_scenes import Scene, _Draw

RADII = (1.0, 1.0, -1.0, 0.5, 2.0, 0.3)
RATIOS = (1.0, -1.0, 2.0, 0.5, -3.0, 1.25)


def machine(
    seed: int,
    ties: bool = True,
    clutches: bool = False,
    gaps: bool = False,
    stops: bool = False,
    opens: bool = False,
) -> Scene:
    """Return two to five bodies with contacts at radii, springs and loads, and the elements that are asked for.

    These are: gears, planetaries and loops of them; one-way clutches alone and beside contacts; elastic gaps; rigid
    stops; contacts that open and close.
    """
    draw = _Draw(seed)
    stop = draw.one([1.0, 2.0, 4.0])
    count = draw.whole(2, 5)
    names = [f"b{i}" for i in range(count)]
    speed = [draw.one([0.0, draw.number(-2, 2, 2)]) for _ in names]
    inertia = [draw.number(0.3, 3, 2) for _ in names]
    place = [draw.one([0.0, draw.number(-0.3, 0.3, 2)]) for _ in names]
    rows: list[Scene] = []
    fixed: list[Scene] = []
    if draw.chance(0.35):
        fixed.append({"name": "drive", "inertia": None, "velocity": _speed(draw, stop, jumps=not stops)})
    ends = [*names, "ground", *(["drive"] if fixed else [])]
    if ties and count > 2:
        _tie(draw, speed, inertia, rows)
    for k in range(draw.whole(1, 3)):
        rows.append(_contact(draw, f"c{k}", _pair(draw, names, ends), stop, opens))
    if clutches:
        _clutches(draw, names, ends, speed, rows, stop)
    if gaps:
        for k in range(draw.whole(1, 2)):
            rows.append(_gap(draw, f"g{k}", _pair(draw, names, ends)))
    if stops:
        for k in range(draw.whole(1, 2)):
            rows.append(_stop(draw, f"s{k}", _pair(draw, names, ends), dict(zip(names, place, strict=True))))
    bodies = [
        {"name": n, "inertia": m, "velocity": v, "position": x}
        for n, m, v, x in zip(names, inertia, speed, place, strict=True)
    ]
    springs = []
    for _ in range(draw.whole(0, 2)):
        stiffness = draw.one([0.0, draw.number(2, 40, 1)])
        damping = draw.number(0.1, 2, 1) if stiffness == 0 else draw.one([0, 0, 0.2])
        springs.append({"on": _pair(draw, names, ends), "k": stiffness, "c": damping})
    forces: list[Scene] = []
    for name in names:
        if draw.chance(0.6):
            forces.append({"body": name, "load": _load(draw, stop)})
    return {"bodies": bodies + fixed, "rows": rows, "springs": springs, "forces": forces, "t_end": stop}


def _pair(draw: _Draw, names: list[str], ends: list[str]) -> dict[str, float]:
    a = draw.one(names)
    b = draw.one([end for end in ends if end != a])
    return {a: draw.one(list(RADII)), b: -draw.one(list(RADII))}


def _load(draw: _Draw, stop: float) -> Any:
    if draw.chance(0.4):
        return {
            "amplitude": draw.number(1, 15, 1),
            "frequency": draw.number(0.3, 2, 2),
            "phase": draw.number(0, 3, 1),
        }
    return draw.one([draw.number(-5, 5, 1), draw.lines(stop, -12, 12, draw.whole(2, 5))])


def _speed(draw: _Draw, stop: float, jumps: bool) -> Any:
    lines = draw.lines(stop, -1, 1, draw.whole(2, 4), jumps=jumps and draw.chance(0.4))
    return draw.one([lines, draw.number(-1, 1, 1)])


def _contact(draw: _Draw, name: str, on: dict[str, float], stop: float, opens: bool = False) -> Scene:
    lowest = -15 if opens else 1
    normal = draw.one([draw.number(2, 20, 1), draw.lines(stop, lowest, 20, draw.whole(2, 4))])
    found = draw.contact(name, "", "", normal)
    if draw.chance(0.4):  # no peak
        found["mu_s"] = found["mu_c"]
        if "mu_s_back" in found:
            found["mu_s_back"] = found["mu_c_back"]
    del found["a"], found["b"]
    return {"kind": "contact", "on": on} | found


def _tie(draw: _Draw, speed: list[float], inertia: list[float], rows: list[Scene]) -> None:
    """Tie some bodies, with speeds that agree; at times in a loop, or with a body without inertia."""
    kind = draw.one(["gear", "loop", "planetary", "lever", "two"])
    if kind == "planetary":
        ratio = draw.one([1.5, 2.0, 3.0])
        rows.append({"kind": "tie", "name": "t0", "on": {"b0": -1.0, "b1": 1.0 + ratio, "b2": -ratio}})
        speed[2] = ((1.0 + ratio) * speed[1] - speed[0]) / ratio
        inertia[2] = draw.one([0.0, inertia[2]])
        return
    if kind == "lever":
        a, b, c = (draw.one(list(RATIOS)) for _ in range(3))
        rows.append({"kind": "tie", "name": "t0", "on": {"b0": a, "b1": b, "b2": c}})
        speed[2] = -(a * speed[0] + b * speed[1]) / c
        inertia[2] = draw.one([0.0, inertia[2]])
        return
    ratio = draw.one(list(RATIOS))
    rows.append({"kind": "tie", "name": "t0", "on": {"b0": 1.0, "b1": -ratio}})
    speed[0] = ratio * speed[1]
    inertia[0] = draw.one([0.0, inertia[0], inertia[0]])
    if kind in ("loop", "two"):
        other = draw.one(list(RATIOS))
        rows.append({"kind": "tie", "name": "t1", "on": {"b2": 1.0, "b1": -other}})
        speed[2] = other * speed[1]
        if kind == "loop":
            rows.append({"kind": "tie", "name": "t2", "on": {"b0": 2.0 * other, "b2": -2.0 * ratio}})


def _clutches(
    draw: _Draw, names: list[str], ends: list[str], speed: list[float], rows: list[Scene], stop: float
) -> None:
    """One-way clutches that start free or locked, alone and beside contacts."""
    for k in range(draw.whole(1, 2)):
        on = _pair(draw, names, [end for end in ends if end != "drive"])
        w = sum(c * speed[names.index(name)] for name, c in on.items() if name != "ground")
        if w > 0:
            on = {name: -c for name, c in on.items()}
        on = dict(reversed(on.items())) if next(iter(on)) == "ground" else on
        rows.append({"kind": "one-way", "name": f"o{k}", "on": on})
        if draw.chance(0.4):
            rows.append(_contact(draw, f"p{k}", on, stop))


def _gap(draw: _Draw, name: str, on: dict[str, float]) -> Scene:
    lower, upper = sorted([draw.number(-0.5, 0.1, 2), draw.number(-0.1, 0.5, 2)])
    limits = draw.one([{"lower": lower}, {"upper": upper}, {"lower": lower, "upper": upper}])
    damping = draw.one([0.0, draw.number(0.2, 5, 1), draw.number(5, 30, 1)])
    return {"kind": "gap", "name": name, "on": on, "k": draw.number(10, 400, 0), "c": damping} | limits


def _stop(draw: _Draw, name: str, on: dict[str, float], place: dict[str, float]) -> Scene:
    stretch = sum(c * place.get(end, 0.0) for end, c in on.items())
    lower, upper = (
        round(stretch - draw.number(0.05, 0.5, 2), 3),
        round(stretch + draw.number(0.05, 0.5, 2), 3),
    )
    limits = draw.one([{"lower": lower}, {"upper": upper}, {"lower": lower, "upper": upper}])
    return {"kind": "stop", "name": name, "on": on, "e": draw.one([0.0, 0.0, 0.5, 0.8, 1.0])} | limits


# Scenes by number, and their description.
FAMILIES: dict[str, tuple[Callable[[int], Scene], str]] = {
    "radii": (partial(machine, ties=False), "contacts, springs and dampers at radii"),
    "ties": (machine, "gears, planetaries, levers and loops, bodies without inertia"),
    "clutches": (partial(machine, clutches=True), "one-way clutches, alone and beside contacts, and ties"),
    "gaps": (partial(machine, gaps=True), "elastic gaps, friction and ties"),
    "stops": (partial(machine, stops=True), "rigid stops, friction and ties"),
    "opening": (partial(machine, opens=True), "contacts that open and close, and ties"),
    "machines": (
        partial(machine, clutches=True, gaps=True, stops=True),
        "ties, clutches, gaps and stops together",
    ),
}
