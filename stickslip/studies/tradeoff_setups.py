"""The calls of `simulate` that make sense for a scene, as data that run and that print as a line to paste."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from stickslip.model.laws import DryFriction, Shape
from stickslip.model.scene import Scene
from stickslip.simulation.choice import choose
from stickslip.simulation.result import Result
from stickslip.simulation.simulate import compiled, simulate

TOLERANCES = (3e-2, *(10.0**-k for k in range(2, 12)))
PRE_SLIP = tuple(10.0**-k for k in range(1, 7))  # pre-slip velocities as parts of the velocity scale
SHAPES: tuple[Shape, ...] = ("linear", "tanh", "arctan")
STEPS = (30, 100, 300, 1000, 10_000)

# Numbers of fixed steps of regularised scenes, whose stiffness forbids fewer.
PRE_SLIP_STEPS = (300, 3000, 30_000)
_ABSOLUTE = 0.01  # absolute tolerance, as a part of the relative one at the velocity scale


@dataclass(frozen=True)
class Call:
    """One call of `simulate`."""

    family: str  # calls of one family follow each other from cheap to costly
    options: dict[str, Any] = field(default_factory=dict)  # keyword arguments
    pre_slip: tuple[float, Shape] | None = None  # velocity in m/s or rad/s and shape of a regularised scene

    def run(self, scene: Scene, span: tuple[float, float]) -> Result:
        """Simulate."""
        return simulate(scene if self.pre_slip is None else scene.regularized(*self.pre_slip), span, **self.options)

    @property
    def creeps(self) -> bool:
        """Whether contacts creep where they should stick."""
        return self.pre_slip is not None

    def text(self, span: tuple[float, float]) -> str:
        """Return the line to paste."""
        scene = "scene"
        if self.pre_slip is not None:
            velocity, shape = self.pre_slip
            scene += f".regularized({velocity!r}{'' if shape == 'linear' else f', {shape!r}'})"
        options = "".join(f", {name}={value!r}" for name, value in self.options.items())
        return f"simulate({scene}, {span!r}{options})"


def calls(scene: Scene, span: tuple[float, float], scale: float) -> list[Call]:
    """Return the calls that are applicable, family by family, from cheap to costly.

    `scale` is the size of the velocities in m/s or rad/s.
    """
    found = [*_series(scene, span), *_event_exact(scene, scale), *_fixed_steps(span)]
    if scene.contacts and all(isinstance(contact.law, DryFriction) for contact in scene.contacts):
        found += [*_pre_slip(scale), *_pre_slip_steps(span, scale)]
    return found


def reference_calls() -> Iterator[tuple[Call, Call]]:
    """Yield pairs of tight calls to compare, the tightest first; the first of a pair is the tighter one."""
    for rtol in (1e-13, 1e-12, 1e-11, 1e-10, 1e-9):
        yield (
            Call("reference", _tolerances(rtol, 1.0)),
            Call("reference", {"method": "Adams"} | _tolerances(10 * rtol, 1.0)),
        )


def _tolerances(rtol: float, scale: float) -> dict[str, Any]:
    return {"rtol": float(f"{rtol:.3g}"), "atol": float(f"{_ABSOLUTE * rtol * scale:.1g}")}


def _series(scene: Scene, span: tuple[float, float]) -> Iterator[Call]:
    """Yield the call without options if it takes the series: else it would be CVODE's BDF, which comes later."""
    system = compiled(scene)
    name, _ = choose(system, system.loads(*span), "contact-force", "auto", span[1] - span[0])
    if name == "series":
        yield Call("contact-force, series")


def _event_exact(scene: Scene, scale: float) -> Iterator[Call]:
    known = [("contact-force", "BDF"), ("contact-force", "Adams")]
    if any(isinstance(contact.law, DryFriction) for contact in scene.contacts):
        known += [("merged", "BDF"), ("merged", "Adams"), ("multiplier", "BDF")]
    for formulation, method in known:
        options = {} if formulation == "contact-force" else {"formulation": formulation}
        options |= {"method": method}
        for rtol in TOLERANCES:
            yield Call(f"{formulation}, {method}", options | _tolerances(rtol, scale))


def _fixed_steps(span: tuple[float, float]) -> Iterator[Call]:
    for method, count in product(("RK4", "Euler"), STEPS):
        yield Call(f"contact-force, {method}", {"method": method, "step": _step(span, count)})


def _pre_slip(scale: float) -> Iterator[Call]:
    """Yield the regularised scenes; a tolerance looser than a tenth of the pre-slip velocity is not safe."""
    for shape in SHAPES:
        for method, finer in (("BDF", (0.1, 1e-3)), ("Adams", (0.1,))):
            for part, fraction in product(PRE_SLIP, finer):
                options = {"method": method} | _tolerances(fraction * part, scale)
                yield Call(f"pre-slip {shape}, {method}", options, (float(f"{part * scale:.3g}"), shape))


def _pre_slip_steps(span: tuple[float, float], scale: float) -> Iterator[Call]:
    """Yield regularised scenes at fixed steps, the cheap way of real-time programs."""
    for shape, method, count, part in product(SHAPES, ("RK4", "Euler"), PRE_SLIP_STEPS, PRE_SLIP[:3]):
        options = {"method": method, "step": _step(span, count)}
        yield Call(f"pre-slip {shape}, {method}", options, (float(f"{part * scale:.3g}"), shape))


def _step(span: tuple[float, float], count: int) -> float:
    return float(f"{(span[1] - span[0]) / count:.6g}")
