"""Parameters of a scene by name: ``"brake.law.mu_coulomb"``, ``"wheel.inertia"``, ``"springs[0].stiffness"``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from stickslip.model.checks import finite
from stickslip.model.checks import names as checked_names
from stickslip.model.elements.base import Element, Named, listed
from stickslip.model.quantities import Quantity
from stickslip.model.scene import Scene, place_in
from stickslip.model.signals import Constant, Load, Signal
from stickslip.results.units import units

_STEP = re.compile(r"\.([A-Za-z_]\w*)|\[(\d+)\]")
_AT_START = {"velocity", "position", "rested"}
_SCALE = "scale"
_LOADS = ("normal", "signal", "velocity")

# Fields of signals that have the unit of the signal itself.
_OF_LOADS = ("amplitude", "offset", "value", "values")


@dataclass(frozen=True)
class Parameter:
    """One number of a scene."""

    # ``"ELEMENT.FIELD"`` with the name of a body, drive, contact or another row, or ``"KIND[NUMBER].FIELD"``
    # as in ``"springs[0].stiffness"``. Fields of fields follow after further dots, entries of sequences in
    # brackets: ``"c.law.mu_static"``, ``"c.normal.amplitude"``, ``"forces[0].signal.values[2]"``,
    # ``"lever.coefficients.a"``. A load that is a number is its own value; ``"c.normal.scale"`` multiplies
    # any load by a number, which is 1 in the scene
    name: str
    place: int  # place of its element among ``scene.elements``
    steps: tuple[str | int, ...]  # fields and entries that lead to it
    value: float  # in the scene it was read from
    only_at_start: bool  # whether it says where the motion starts, not how it goes on
    twin: tuple[str | int, ...] = ()  # steps to a number of the same element that takes the same value
    scaled: Signal | Quantity | None = None  # the load of which it is a factor

    def set(self, scene: Scene, value: float) -> Scene:
        """Return the scene with the parameter at another value."""
        elements: list[Any] = list(scene.elements)
        element = elements[self.place]
        both = [steps for steps in (self.twin, self.steps) if steps]
        # a static coefficient rises before a Coulomb one, and falls after it
        for steps in both if value > self.value else both[::-1]:
            element = _changed(element, steps, float(value), self.scaled)
        elements[self.place] = element
        return Scene(*elements, motion=scene.motion)

    def with_static(self, scene: Scene, value: float) -> Parameter:
        """Return the parameter; a Coulomb coefficient that would exceed its static one takes this one along."""
        last = str(self.steps[-1]) if self.steps else ""
        if last not in ("mu_coulomb", "mu_coulomb_backward"):
            return self
        static = (*self.steps[:-1], last.replace("coulomb", "static"))
        try:
            limit, _ = _value(scene.elements[self.place], static, self.name, "")
        except ValueError:  # there is no static coefficient of its own
            return self
        return replace(self, twin=static) if value > limit else self

    def unit(self, scene: Scene) -> str:
        """Return the SI unit, as far as the name tells it; an empty text for a pure number."""
        own, last = units(scene, scene.elements[self.place]), self.field
        known = {
            **dict.fromkeys(("dwell", "rested", "times", "period"), "s"),
            "frequency": "1/s",
            "phase": "rad",
            "normal": "N",
            "signal": own.force,
            **dict.fromkeys(("rest", "upper", "lower"), own.position),
            "stribeck_velocity": own.velocity,
        }
        return known.get(last) or str(getattr(own, last, ""))

    @property
    def field(self) -> str:
        """The field that the number belongs to; for a value of a load, the field that holds the load."""
        fields = [step for step in self.steps if isinstance(step, str)]
        last = fields[-1] if fields else ""
        return next((field for field in fields if field in _LOADS), "") if last in _OF_LOADS else last

    def distances_to_neighbours(self, scene: Scene) -> tuple[float, ...]:
        """Return the distances to the entries before and after it, where it is an entry of a sequence of numbers."""
        if not self.steps or not isinstance(place := self.steps[-1], int):
            return ()
        entries: Any = scene.elements[self.place]
        for step in self.steps[:-1]:
            entries = _inside(entries, step, self.name, "parameter")
        others = (entries[k] for k in (place - 1, place + 1) if 0 <= k < len(entries))
        return tuple(abs(other - self.value) for other in others)

    def scales(self, other: Parameter) -> bool:
        """Tell whether it is a factor of the load that the other one is a number of."""
        load = self.steps[:-1]
        is_inside = other.place == self.place and other.steps[: len(load)] == load and other != self
        return self.scaled is not None and is_inside

    def at(self, value: float) -> Parameter:
        """Return the parameter as it is in a scene in which it has another value."""
        return replace(self, value=value)


def named_parameters(scene: Scene, names: Iterable[str], what: str, *, together: bool = False) -> list[Parameter]:
    """Return the parameters of a scene that have these names.

    `what` begins the message of an error: where a name leads to no number, or where all are to change `together` and
    one of them multiplies another.
    """
    given = checked_names(list(names) if isinstance(names, Mapping) else names, f"{what}: parameters")
    if not given:
        raise ValueError(f"{what}: parameters is empty; name at least one, such as 'wheel.inertia'")
    found = [_named(scene, name, what) for name in given]
    places = [(one.place, one.steps) for one in found]
    for k, one in enumerate(found):
        if places[k] in places[:k]:
            other = found[places.index(places[k])].name
            said = "stands twice" if other == one.name else f"is {other!r} by another name"
            raise ValueError(f"{what}: parameter {one.name!r} {said}; leave one out")
        inner = next((other for other in found if one.scales(other)), None)
        if together and inner is not None:
            raise ValueError(f"{what}: parameter {one.name!r} multiplies {inner.name!r}, too; leave one out")
    return found


def with_values(scene: Scene, parameters: Sequence[Parameter], values: Sequence[float]) -> Scene:
    """Return the scene with some parameters at other values.

    They are set one after another. A value that is refused beside the old value of another parameter, as a lower limit
    beyond the upper one, waits until that parameter is set.
    """
    waiting = list(zip(parameters, values, strict=True))
    while waiting:
        refused: list[ValueError] = []
        for one, value in waiting:
            try:
                scene = one.set(scene, value)
            except ValueError as error:
                refused.append(error)
            else:
                break
        if len(refused) == len(waiting):
            raise refused[0]
        del waiting[len(refused)]
    return scene


def _named(scene: Scene, name: str, what: str) -> Parameter:
    name = str(name)
    place, rest = _element(scene, name, what)
    steps: list[str | int] = []
    at = 0
    while at < len(rest):
        match = _STEP.match(rest, at)
        if match is None:
            raise ValueError(
                f"{what}: parameter {name!r} cannot be read at {rest[at:]!r}; write fields as '.field' and "
                "entries of sequences as '[0]'"
            )
        steps.append(match[1] if match[1] is not None else int(match[2]))
        at = match.end()
    element = scene.elements[place]
    value, scaled = _value(element, tuple(steps), name, what)
    kind = type(element).__name__
    start = kind in ("Body", "Drive", "Contact") and len(steps) == 1 and steps[0] in _AT_START
    only_at_start = start and not (kind == "Drive" and steps[0] == "velocity")
    return Parameter(name, place, tuple(steps), value, only_at_start, scaled=scaled)


def _element(scene: Scene, name: str, what: str) -> tuple[int, str]:
    """Return the place of the element that a parameter's name begins with, and the rest of the name."""
    indexed = re.match(r"(\w+)\[(\d+)\]", name)
    if indexed is not None and isinstance(among := getattr(scene, indexed[1], None), tuple):
        number = int(indexed[2])
        if number >= len(among):
            raise ValueError(f"{what}: parameter {name!r}: the scene has {len(among)} {indexed[1]}, counted from 0")
        return place_in(scene, among, number), name[indexed.end() :]
    named = [(k, e) for k, e in enumerate(scene.elements) if isinstance(e, Named)]
    called = [(k, e) for k, e in named if name.startswith(e.name + ".")]
    longest = max((len(e.name) for _, e in called), default=0)
    called = [(k, e) for k, e in called if len(e.name) == longest]
    if not called:
        known = {e.name for _, e in named}
        raise ValueError(
            f"{what}: parameter {name!r} begins with no element's name; write 'NAME.field' with one of "
            f"{listed(known)}, or 'springs[0].stiffness'"
        )
    if len(called) > 1:
        fitting = [one for one in called if _leads(one[1], name[longest:])]
        if len(fitting) != 1:
            raise ValueError(
                f"{what}: parameter {name!r}: a body and a contact are both called {called[0][1].name!r}; "
                "rename one of them"
            )
        called = fitting
    return called[0][0], name[longest:]


def _leads(element: Element, rest: str) -> bool:
    match = _STEP.match(rest)
    return match is not None and match[1] in _names_in(element)


def _names_in(thing: Any) -> list[str]:
    """Return the names of the fields of an element or of another part of a scene, or of the entries of a table."""
    if isinstance(thing, Mapping):
        return list(thing)
    return [field.name for field in fields(thing)] if is_dataclass(thing) else []


def _value(thing: Any, steps: tuple[str | int, ...], name: str, what: str) -> tuple[float, Signal | Quantity | None]:
    """Return a number inside a thing, and the load of which it is a factor."""
    for step in steps:
        if step == _SCALE and isinstance(thing, (Signal, Quantity)):
            return 1.0, thing
        thing = _inside(thing, step, name, what)
    if isinstance(thing, Constant):
        thing = thing.value
    if thing is None:
        raise ValueError(f"{what}: parameter {name!r} is not set in the scene; give it a value there first")
    if isinstance(thing, Load):
        raise ValueError(
            f"{what}: parameter {name!r} is a load over time or of the state; name a number of it"
            f"{_numbers(thing, name)} or '{name}.scale', which multiplies it"
        )
    if type(thing) is int:  # elements keep all other numbers as floats
        raise ValueError(f"{what}: parameter {name!r} is a whole number; name one that can change a little")
    if not isinstance(thing, float):
        raise ValueError(f"{what}: parameter {name!r} is {type(thing).__name__}, not a number{_numbers(thing, name)}")
    return finite(thing, f"{what}: parameter {name!r}"), None


def _inside(thing: Any, step: str | int, name: str, what: str) -> Any:
    if isinstance(step, int):
        if not isinstance(thing, tuple) or step >= len(thing):
            raise ValueError(f"{what}: parameter {name!r}: there is no entry [{step}]")
        return thing[step]
    inside = _names_in(thing)
    if step not in inside:
        known = ", ".join(inside) or "no fields"
        within = step in _names_in(getattr(thing, "law", None))
        remedy = f"; write '{name.removesuffix(step)}law.{step}'" if within else ""
        raise ValueError(f"{what}: parameter {name!r}: {type(thing).__name__} has {known}, not {step!r}{remedy}")
    return thing[step] if isinstance(thing, Mapping) else getattr(thing, step)


def _numbers(thing: Any, name: str) -> str:
    """Return names of numbers inside a thing, as the end of a message."""
    if not is_dataclass(thing):
        return ""
    values = {one: getattr(thing, one) for one in _names_in(thing)}
    inside = [f"'{name}.{one}'" for one, x in values.items() if isinstance(x, int | float) and not isinstance(x, bool)]
    return f", such as {', '.join(inside[:8])}" if inside else ""


def _changed(thing: Any, steps: tuple[str | int, ...], value: float, scaled: Signal | Quantity | None) -> Any:
    if not steps:
        return Constant(finite(value, "a load")) if isinstance(thing, Constant) else value
    step, rest = steps[0], steps[1:]
    if step == _SCALE and scaled is not None:
        return scaled * value
    if isinstance(step, int):
        return (*thing[:step], _changed(thing[step], rest, value, scaled), *thing[step + 1 :])
    if isinstance(thing, Mapping):
        return {**thing, step: _changed(thing[step], rest, value, scaled)}
    made = replace(thing, **{step: _changed(getattr(thing, step), rest, value, scaled)})
    return made.checked() if isinstance(made, Load) else made
