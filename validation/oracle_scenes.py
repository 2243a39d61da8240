"""Families of random scenes as plain data, each scene from a seed. Round numbers make things happen at once."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from random import Random
from typing import Any

Scene = dict[str, Any]
Points = list[list[float]]
Load = float | Points


class _Draw:
    """Numbers, loads and contacts drawn from a seed."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)

    def one(self, choices: list[Any]) -> Any:
        return self.random.choice(choices)

    def number(self, low: float, high: float, digits: int) -> float:
        return round(self.random.uniform(low, high), digits)

    def whole(self, low: int, high: int) -> int:
        return self.random.randint(low, high)

    def chance(self, probability: float) -> bool:
        return self.random.random() < probability

    def pulse(self, stop: float, peak: float) -> Points:
        """Return a triangle within the span."""
        times: list[float] = []
        while len(times) < 3:
            times = sorted({self.number(0, stop, 2) for _ in range(3)})
        return [[times[0], 0.0], [times[1], round(peak, 1)], [times[2], 0.0]]

    def lines(self, stop: float, low: float, high: float, count: int, jumps: bool = True) -> Points:
        """Return a piecewise linear load, which may jump at its points."""
        times = sorted({self.number(0, stop, 2) for _ in range(count)})
        points: Points = []
        for t in times:
            points.append([t, self.number(low, high, 1)])
            if jumps and self.chance(0.3):
                points.append([t, self.number(low, high, 1)])
        if len(points) > 1:
            return points
        return [[0.0, points[0][1]], [stop, self.number(low, high, 1)]]

    def contact(self, name: str, a: str, b: str, normal: Load) -> Scene:
        """Return a contact, with a dwell time, other coefficients backwards, time rested or swapped ends at times."""
        kinetic = self.number(0.05, 0.4, 2)
        static = round(kinetic * self.random.uniform(1.1, 2.5), 3)
        tau = self.one([0, 0, 0, 0.05, 0.1, 0.5])
        contact: Scene = {"name": name, "a": a, "b": b, "normal": normal}
        contact |= {"mu_s": static, "mu_c": kinetic, "tau": tau}
        if self.chance(0.25):
            contact["mu_c_back"] = self.number(0.05, 0.4, 2)
            contact["mu_s_back"] = round(contact["mu_c_back"] * self.random.uniform(1.1, 2.5), 3)
        if self.chance(0.2):
            contact["rested"] = self.number(0, 2, 2)
        if self.chance(0.15):
            contact["a"], contact["b"] = b, a
        return contact


def wheels(seed: int, loops: bool = False, dampers: bool = False, opened: bool = False) -> Scene:
    """Return one to five wheels in a chain, star or tree, with brakes, and perhaps a drive.

    Contacts may close loops, dampers may lie beside contacts, and normal forces may become negative for a while.
    """
    draw = _Draw(seed)
    stop = draw.one([1.0, 2.0, 4.0])
    count, digits = draw.whole(1, 5), draw.one([1, 2, 2, 6])
    bodies = [_wheel(draw, i, digits) for i in range(count)]
    contacts: list[Scene] = []
    shape = draw.one(["chain", "star", "tree"])

    def join(name: str, a: str, b: str) -> None:
        contacts.append(draw.contact(name, a, b, _normal(draw, stop, opened)))

    for i in range(1, count):
        hub = {"chain": i - 1, "star": 0}.get(shape)
        hub = draw.random.randrange(i) if hub is None else hub
        join(f"c{hub}{i}", f"w{hub}", f"w{i}")
    for k in range(draw.whole(1, 3) if loops else 0):
        if count > 1:
            a, b = draw.random.sample(range(count), 2)
            join(f"x{k}", f"w{a}", f"w{b}")
    if draw.chance(0.4):
        bodies.append({"name": "drive", "inertia": None, "velocity": _speed(draw, stop)})
        join("driven", f"w{draw.random.randrange(count)}", "drive")
    for k in range(draw.whole(1, 3 if loops else 2)):
        wheel = f"w{draw.random.randrange(count)}"
        pulse = draw.chance(0.7)
        normal: Load = draw.pulse(stop, draw.random.uniform(50, 400)) if pulse else _normal(draw, stop, opened)
        contacts.append(draw.contact(f"brake{k}", wheel, "ground", normal))
    if draw.chance(0.2):
        join("bearing", f"w{draw.random.randrange(count)}", "ground")
    forces = [{"body": f"w{i}", "load": _load(draw, stop)} for i in range(count) if draw.chance(0.4)]
    springs = [
        {"a": c["a"], "b": c["b"], "k": 0.0, "c": draw.number(0.1, 8, 1)}
        for c in (contacts if dampers else [])
        if draw.chance(0.6)
    ]
    return {"bodies": bodies, "contacts": contacts, "springs": springs, "forces": forces, "t_end": stop}


def _wheel(draw: _Draw, i: int, digits: int) -> Scene:
    inertia = draw.one([1, 2, 0.5, draw.number(0.2, 5, 2)])
    velocity = draw.number(-2, 2, digits) if draw.chance(0.8) else 1.0
    return {"name": f"w{i}", "inertia": inertia, "velocity": velocity}


def _normal(draw: _Draw, stop: float, opened: bool) -> Load:
    kind = draw.random.random()
    if opened and kind < 0.6:
        return draw.lines(stop, -40, 80, draw.whole(2, 6))
    if kind < 0.75:
        return draw.one([10, 20, 30, 60, 100, draw.number(2, 100, 1)])
    return draw.lines(stop, -30 if opened else 0, 100, draw.whole(2, 5))


def _speed(draw: _Draw, stop: float) -> Load:
    if draw.chance(0.6):
        return draw.lines(stop, -2, 2, draw.whole(2, 4), jumps=draw.chance(0.4))
    return draw.number(-2, 2, 1)


def _load(draw: _Draw, stop: float) -> Load:
    pulse = draw.pulse(stop, draw.random.uniform(-60, 60))
    lines = draw.lines(stop, -30, 30, draw.whole(2, 5))
    return draw.one([pulse, lines, draw.number(-5, 5, 1)])


def blocks(seed: int) -> Scene:
    """Return one to four blocks on the floor, pulled through springs by a plate that moves."""
    draw = _Draw(seed)
    stop = draw.one([10.0, 20.0, 40.0])
    count = draw.whole(1, 4)
    bodies = [
        {
            "name": f"b{i}",
            "inertia": draw.number(0.5, 2, 2),
            "velocity": draw.one([0, 0, draw.number(-0.3, 0.3, 2)]),
            "position": draw.one([0, draw.number(-0.2, 0.2, 2)]),
        }
        for i in range(count)
    ]
    plate = draw.one([0.1, draw.number(0.05, 0.4, 2), draw.lines(stop, -0.3, 0.4, draw.whole(2, 5), jumps=False)])
    bodies.append({"name": "plate", "inertia": None, "velocity": plate})
    contacts = [draw.contact(f"f{i}", f"b{i}", "ground", _weight(draw, stop)) for i in range(count)]
    springs = [
        {
            "a": f"b{i}",
            "b": "plate",
            "k": draw.number(0.5, 4, 1),
            "c": draw.one([0, 0.05, 0.3]),
            "rest": draw.one([0, 0, draw.number(-0.1, 0.1, 2)]),
        }
        for i in range(count)
        if i == 0 or draw.chance(0.7)
    ]
    for i in range(1, count):
        a, b = f"b{i - 1}", f"b{i}"
        if draw.chance(0.7):
            springs.append({"a": a, "b": b, "k": draw.number(0.5, 5, 1), "c": draw.one([0, 0, 0.1])})
        elif draw.chance(0.5):
            contacts.append(draw.contact(f"j{i}", a, b, draw.number(0.5, 4, 1)))
    if draw.chance(0.3):
        contacts.append(draw.contact("belt", "b0", "plate", draw.number(0.5, 3, 1)))
    forces = []
    if draw.chance(0.3):
        forces.append({"body": "b0", "load": draw.lines(stop, -1, 1, draw.whole(2, 6))})
    return {"bodies": bodies, "contacts": contacts, "springs": springs, "forces": forces, "t_end": stop}


def _weight(draw: _Draw, stop: float) -> Load:
    numbers = [5, draw.number(1, 8, 1), draw.number(1, 8, 1)]
    return draw.one([*numbers, draw.lines(stop, 0, 8, draw.whole(2, 5), jumps=draw.chance(0.5))])


def mixed(seed: int) -> Scene:
    """Return wheels whose contacts open, with springs between them."""
    scene = wheels(seed, dampers=_Draw(seed + 5).chance(0.5), opened=True)
    draw = _Draw(seed + 10**6)
    count = sum(body["inertia"] is not None for body in scene["bodies"])
    for _ in range(draw.whole(1, 3)):
        a, b = "w0", "ground"
        if count > 1:
            a, b = (f"w{i}" for i in draw.random.sample(range(count), 2))
        stiffness = draw.number(5, 100, 1)
        damping = draw.one([0, 0.2, 1] if count > 1 else [0, 0.2])
        scene["springs"].append({"a": a, "b": b, "k": stiffness, "c": damping})
    return scene


def symmetric(seed: int) -> Scene:
    """Return a hub and two to four equal arms, which stick and slip at once."""
    draw = _Draw(seed)
    stop, count = 2.0, draw.whole(2, 4)
    bodies = [{"name": "hub", "inertia": draw.one([1, 2, 3]), "velocity": draw.one([0, 2.0, 1.0])}]
    arm: Scene = {"inertia": draw.one([1, 0.5]), "velocity": draw.one([0, 1.8, 1.0])}
    joint = draw.contact("", "hub", "arm", draw.one([20, 60, draw.lines(stop, 0, 80, 3)]))
    brake = draw.contact("", "arm", "ground", draw.pulse(stop, draw.random.uniform(50, 300)))
    braked = draw.chance(0.7)
    on_arms = draw.one([None, draw.pulse(stop, draw.one([25, 40, -60])), draw.lines(stop, -30, 30, 4)])
    on_hub = draw.one([None, draw.pulse(stop, draw.one([25, 60, -90])), draw.lines(stop, -60, 60, 4)])
    sprung, stiffness = draw.chance(0.4), draw.number(5, 50, 1)
    scene: Scene = {"bodies": bodies, "contacts": [], "springs": [], "forces": [], "t_end": stop}
    for i in range(count):
        name = f"arm{i}"
        bodies.append({"name": name} | arm)
        for contact, kind in ((joint, "joint"), (brake, "brake"))[: 2 if braked else 1]:
            ends = {end: name if contact[end] == "arm" else contact[end] for end in "ab"}
            scene["contacts"].append(contact | ends | {"name": f"{kind}{i}"})
        if on_arms:
            scene["forces"].append({"body": name, "load": on_arms})
        if sprung:
            scene["springs"].append({"a": "hub", "b": name, "k": stiffness, "c": 0.2})
    if on_hub:
        scene["forces"].append({"body": "hub", "load": on_hub})
    return scene


def curved(seed: int) -> Scene:
    """Return wheels or blocks with Stribeck curves and sines for loads and normal forces."""
    scene = _Draw(seed).one([wheels, blocks])(seed)
    draw, stop = _Draw(seed + 77), scene["t_end"]
    for contact in scene["contacts"]:
        if draw.chance(0.6):
            contact |= {"vs": draw.number(0.02, 0.5, 2), "delta": draw.one([1.0, 2.0]), "tau": 0}
    if draw.chance(0.7):
        frequency = draw.number(1, 8, 1) / stop
        amplitude = draw.number(1, 20, 1) if stop < 5 else draw.number(0.5, 4, 1)
        sine = {"amplitude": amplitude, "frequency": frequency, "phase": draw.number(0, 3, 1)}
        scene["forces"].append({"body": scene["bodies"][0]["name"], "load": sine})
        scene["max_step"] = 0.05 / frequency
    if draw.chance(0.3):
        frequency, offset = draw.number(1, 6, 1) / stop, draw.number(5, 50, 1)
        amplitude = offset * draw.random.uniform(0.2, 0.9)
        normal = {"amplitude": amplitude, "frequency": frequency, "offset": offset}
        scene["contacts"][0]["normal"] = normal
    return scene


def one_way(seed: int) -> Scene:
    """Return wheels or blocks with anisotropic laws, most of them frictionless one way, under sines."""
    scene = curved(seed)
    draw = _Draw(seed + 99)
    for contact in scene["contacts"]:
        if not draw.chance(0.8):
            continue
        for key in ("vs", "delta"):
            contact.pop(key, None)
        ways = [contact["mu_s"], contact["mu_c"]], _coefficients(draw)
        if draw.chance(0.7):
            ways[1][:] = [0.0, 0.0]
        (contact["mu_s"], contact["mu_c"]), back = ways[:: draw.one([1, -1])]
        contact["mu_s_back"], contact["mu_c_back"] = back
    return scene


def _coefficients(draw: _Draw) -> list[float]:
    kinetic = draw.number(0.05, 0.6, 2)
    return [round(kinetic * draw.one([1.0, 1.3, 2.5]), 3), kinetic]


def _ends(draw: _Draw, count: int, more: tuple[int, int] | None) -> list[tuple[str, str]]:
    """Return the ends of contacts: each body rests on one before it or on the ground; some contacts are added."""
    ends = [(i, draw.one([-1, *range(i)])) for i in range(count)]
    for _ in range(draw.whole(*more) if more else 0):
        a, b = draw.random.sample(range(-1, count), 2)
        ends.append((a, b) if a >= 0 else (b, a))
    return [(f"b{a}", "ground" if b < 0 else f"b{b}") for a, b in ends]


def _spring(draw: _Draw, count: int) -> list[Scene]:
    """Return a spring between two bodies, or none."""
    if not draw.chance(0.3):
        return []
    a, b = "b0", "ground" if count == 1 else "b1"
    return [{"a": a, "b": b, "k": draw.number(1, 20, 1), "c": draw.one([0, 0.5])}]


def closing(seed: int, loops: bool = False) -> Scene:
    """Return bodies whose contacts all open and close together, where nearly all forces are 0; some loads are sines."""
    draw = _Draw(seed)
    count, stop = draw.whole(1, 4), 4.0
    bodies = [{"name": f"b{i}", "inertia": draw.number(0.3, 3, 2), "velocity": 0.0} for i in range(count)]
    contacts, forces = [], []
    for k, (a, b) in enumerate(_ends(draw, count, (1, 2) if loops else None)):
        (static, kinetic), (static_back, kinetic_back) = _coefficients(draw), _coefficients(draw)
        if draw.chance(0.3):
            static_back = kinetic_back = 0.0
        peak, low = draw.number(2, 10, 1), draw.one([0.0, 0.0, -2.0])
        contact = {"name": f"c{k}", "a": a, "b": b, "tau": draw.one([0, 0, 0.1])}
        contact |= {"normal": [[1.0, 0.0], [2.0, peak], [2.5, low], [3.0, peak]]}
        contact |= {"mu_s": static, "mu_c": kinetic, "mu_s_back": static_back, "mu_c_back": kinetic_back}
        contacts.append(contact)
    for body in bodies:
        push = draw.number(-12, 12, 1)
        load = [[1.0, 0.0], [2.0, push], [2.5, 0.0], [3.0, -0.5 * push]]
        forces.append({"body": body["name"], "load": load})
    scene: Scene = {"bodies": bodies, "contacts": contacts, "forces": forces, "t_end": stop}
    if draw.chance(0.7):
        # a large sine or a small one; without loops the small one is too small to move anything
        sine = {"amplitude": draw.one([draw.number(0.5, 4, 1), 0.1 if loops else 1e-25])}
        sine |= {"frequency": draw.number(0.3, 2, 2), "phase": draw.one([0, draw.number(0, 3, 1)])}
        forces.append({"body": draw.one(bodies)["name"], "load": sine})
        scene["max_step"] = 0.05
    return scene | {"springs": _spring(draw, count)}


def together(seed: int) -> Scene:
    """Return bodies held by contacts side by side and in loops, of levels far apart, under lines and sines."""
    draw = _Draw(seed)
    count, stop = draw.whole(1, 3), draw.one([2.0, 4.0])
    bodies = [
        {
            "name": f"b{i}",
            "inertia": draw.number(0.3, 3, 2),
            "velocity": draw.one([0.0, draw.number(-1, 1, 2)]),
        }
        for i in range(count)
    ]
    contacts = []
    for k, (a, b) in enumerate(_ends(draw, count, (1, 4))):
        level = draw.one([5.0, 20.0, draw.number(1, 30, 1), draw.lines(stop, 0, 20, draw.whole(2, 4))])
        contacts.append(draw.contact(f"c{k}", a, b, level))
    forces: list[Scene] = [
        {"body": body["name"], "load": draw.lines(stop, -8, 8, draw.whole(2, 5), jumps=draw.chance(0.3))}
        for body in bodies
    ]
    scene: Scene = {"bodies": bodies, "contacts": contacts, "forces": forces, "t_end": stop}
    if draw.chance(0.5):
        sine = {"amplitude": draw.number(0.5, 6, 1), "frequency": draw.number(0.2, 2, 1)}
        sine |= {"phase": draw.number(0, 3, 1)}
        forces.append({"body": draw.one(bodies)["name"], "load": sine})
        scene["max_step"] = 0.05
    return scene | {"springs": _spring(draw, count)}


def pressed(seed: int) -> Scene:
    """Return wheels or blocks without loops, whose normal forces follow the motion, through 0 and back."""
    draw = _Draw(seed + 2**20)
    curves = draw.chance(0.25)
    scene = tree(draw.one([curved, one_way] if curves else [mixed, blocks, blocks]), seed)
    names = [body["name"] for body in scene["bodies"]]
    slow = scene["t_end"] > 5
    chosen = [contact for contact in scene["contacts"] if draw.chance(0.6)] or scene["contacts"][:1]
    for contact in chosen:
        if isinstance(contact["normal"], dict):
            continue
        own = [("stretch", contact["name"]), ("relative_velocity", contact["name"])]
        of_bodies = [(kind, draw.one(names)) for kind in ("position", "velocity", "velocity")]
        terms = draw.random.sample([*own, *of_bodies], draw.one([1, 1, 2]))
        size = draw.one([2.0, 6.0, 15.0]) if slow else draw.one([10.0, 30.0, 80.0])
        contact["pressed_by"] = [[*term, draw.number(-size, size, 1)] for term in terms]
        if draw.chance(0.2):
            # the normal force starts at 0, and stays 0 as long as nothing moves
            contact["normal"] = 0.0
    return scene


def tree(draw: Callable[[int], Scene], seed: int) -> Scene:
    """Return a scene of another family without the contacts that close loops: its answer is unique to the end."""
    scene = draw(seed)
    fixed = ["ground", *(body["name"] for body in scene["bodies"] if body["inertia"] is None)]
    group = {body["name"]: {body["name"]} for body in scene["bodies"]} | {name: set(fixed) for name in fixed}
    kept = []
    for contact in scene["contacts"]:
        a, b = contact["a"], contact["b"]
        if b not in group[a]:
            kept.append(contact)
            both = group[a] | group[b]
            group |= dict.fromkeys(both, both)
    return scene | {"contacts": kept}


# Scenes by number, and their description.
FAMILIES: dict[str, tuple[Callable[[int], Scene], str]] = {
    "wheels": (wheels, "wheels in chains, stars and trees, with brakes and drives"),
    "dampers": (partial(wheels, dampers=True), "wheels with dampers beside the contacts"),
    "opened": (partial(wheels, opened=True), "wheels with contacts that open"),
    "loops": (partial(wheels, loops=True), "wheels with contacts in loops and side by side"),
    "everything": (
        partial(wheels, loops=True, dampers=True, opened=True),
        "wheels with dampers, loops, and contacts that open",
    ),
    "blocks": (blocks, "blocks pulled over the floor through springs"),
    "mixed": (mixed, "wheels with springs, dampers, and contacts that open"),
    "symmetric": (symmetric, "a hub and equal arms that stick and slip at once"),
    "curved": (curved, "Stribeck curves, and sines for loads and normal forces"),
    "trees": (partial(tree, mixed), "wheels with springs, dampers, contacts that open, and no loops"),
    "curved-trees": (
        partial(tree, curved),
        "Stribeck curves, and sines for loads and normal forces, without loops",
    ),
    "one-way": (one_way, "anisotropic laws, frictionless one way, under sines"),
    "closing": (closing, "anisotropic contacts that open and close together, beside sines"),
    "closing-loops": (
        partial(closing, loops=True),
        "contacts in loops that open and close together, beside sines",
    ),
    "pressed": (pressed, "normal forces that follow the motion through 0, without loops"),
    "together": (together, "contacts side by side and in loops, of levels far apart"),
}
