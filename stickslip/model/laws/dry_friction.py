"""The base class of friction laws, and the law from which all others take their coefficients."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from stickslip.model.checks import NamedArguments, as_number, check_entries, finite
from stickslip.model.laws.base import Character, Kernel, Use
from stickslip.model.laws.kinetic import Kinetic

_MAKERS: dict[str, type[Law]] = {}

# Part of the static coefficient by which a kinetic curve may exceed it at rest, because sums are rounded.
_ROUNDOFF = 1e-12


class Law(metaclass=NamedArguments):
    """A friction law of a contact: held within an interval, or moving with a force.

    While a contact slips in a known direction its force is ``sign(w) mu_k(|w|) N``; while it is held the force lies
    within ``mu_st N`` on both sides. `character` says when it is held and when it slips. In all other cases `kernel`
    gives the force. A law other than `DryFriction` has an attribute `law` with these coefficients.
    """

    law: DryFriction

    @property
    def core(self) -> DryFriction:
        """The dry friction from which the law takes its coefficients."""
        return self.law

    @property
    def character(self) -> Character:
        """How it behaves near rest: by default as dry friction does."""
        return self.core.character

    @property
    def kernel(self) -> type[Kernel]:
        """The class of its forces where they depend on velocity and the contact does not slip in a known direction."""
        raise NotImplementedError

    def check_use(self, use: Use) -> None:
        """Refuse a contact in which the law does not work."""

    def to_dict(self) -> dict[str, Any]:
        """Return the law as plain data."""
        data: dict[str, Any] = {"type": type(self).__name__}
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if value == field.default:
                continue
            if callable(value):
                raise ValueError(
                    f"{type(self).__name__}.{field.name} is code, not data; it cannot be written to a file"
                )
            data[field.name] = value.to_dict() if isinstance(value, Law) else value
        return data

    def _check_law(self) -> None:
        if not isinstance(self.core, DryFriction):
            raise TypeError(f"{type(self).__name__}: law must be DryFriction, got {self.core!r}")

    def _number(self, name: str) -> float:
        number = finite(getattr(self, name), f"{type(self).__name__}: {name}")
        object.__setattr__(self, name, number)
        return number

    def _check_number(self, name: str, positive: bool) -> None:
        number = self._number(name)
        if number < 0 or (positive and number == 0):
            wanted = "positive" if positive else "at least 0"
            raise ValueError(f"{type(self).__name__}: {name} must be {wanted}, got {number:g}")


def register(law: type[Law]) -> type[Law]:
    """Let scene files name a law by its class."""
    _MAKERS[law.__name__] = law
    return law


class CurveError(ValueError):
    """A kinetic curve returns no valid coefficient; `law` is the law of that curve."""

    def __init__(self, law: DryFriction, told: str) -> None:
        super().__init__(f"DryFriction: {told}")
        self.law = law


@register
@dataclass(frozen=True)
class DryFriction(Law):
    """Static and Coulomb friction with an optional dwell time and Stribeck curve.

    Slipping, ``r = sign(w) mu_k(|w|) N`` with
    ``mu_k = mu_c + (mu_s - mu_c) exp(-(|w|/v_s)^delta)`` where a Stribeck velocity is given and
    ``mu_k = mu_c`` where it is not. Stuck, ``|r| <= B = mu_st N`` with
    ``mu_st = mu_s - (mu_s - mu_c) exp(-(t - t_start)/tau)`` for a dwell time ``tau > 0`` and
    ``mu_st = mu_s`` for ``tau = 0`` (Breedveld 2000, eqs. 8 and 9).

    Sticking friction is never less than friction in slow slip: with a kinetic curve, mu_c in ``mu_st`` becomes
    ``mu_k(0)`` if that is larger. On a Stribeck curve ``mu_k(0)`` is mu_s, so that a dwell time has no effect there.

    Parameters
    ----------
    mu_static, mu_coulomb : float
        Coefficients, ``mu_static >= mu_coulomb >= 0``; lengths in m where the normal force acts on an arm.
    dwell : float
        Dwell time tau in s, in which the static coefficient rises after sticking; without effect beside a
        Stribeck curve.
    stribeck_velocity : float, optional
        Velocity v_s in rad/s or m/s of the Stribeck curve.
    stribeck_exponent : float
        Exponent delta of the Stribeck curve. Below 1 the curve falls infinitely fast at rest, which takes the solver
        several times as many steps.
    mu_static_backward, mu_coulomb_backward : float, optional
        Coefficients for ``w < 0`` of an anisotropic contact.
    kinetic : callable, optional
        ``kinetic(speed) -> mu_k`` for any other kinetic curve, speed >= 0; it may rise above mu_s. Beside it mu_c is
        used only with a dwell time, and only if it is more than ``mu_k(0)``. A curve that rises and falls within the
        range of speeds that one step covers needs `max_step` of `simulate`.

    Raises
    ------
    ValueError, TypeError
        If a coefficient is negative, not finite, or the static one is below the Coulomb one.
    """

    mu_static: float
    mu_coulomb: float
    dwell: float = 0.0
    stribeck_velocity: float | None = None
    stribeck_exponent: float = 2.0
    mu_static_backward: float | None = None
    mu_coulomb_backward: float | None = None
    kinetic: Callable[[float], float] | None = None

    def __post_init__(self) -> None:
        for name in ("mu_static", "mu_coulomb", "dwell", "mu_static_backward", "mu_coulomb_backward"):
            if getattr(self, name) is None and name.endswith("_backward"):
                continue
            if (number := self._number(name)) < 0:
                raise ValueError(f"DryFriction: {name} must not be negative, got {number:g}")
        for direction, suffix in ((1, ""), (-1, "_backward")):
            static, coulomb = self.mu_s(direction), self.mu_c(direction)
            if static < coulomb:
                remedy = "static friction is at least Coulomb friction: swap or equalise them"
                if self.kinetic is not None:
                    remedy = "kinetic tells what resists slip, and may rise: equalise them"
                raise ValueError(
                    f"DryFriction: mu_static{suffix} = {static:g} is below mu_coulomb{suffix} = {coulomb:g}; {remedy}"
                )
        if self.stribeck_velocity is not None and (number := self._number("stribeck_velocity")) <= 0:
            raise ValueError(
                f"DryFriction: stribeck_velocity must be positive, got {number:g}; "
                "leave it out for plain Coulomb friction"
            )
        if (number := self._number("stribeck_exponent")) <= 0:
            raise ValueError(f"DryFriction: stribeck_exponent must be positive, got {number:g}")
        if self.kinetic is not None:
            self._check_kinetic()

    def _check_kinetic(self) -> None:
        if not callable(self.kinetic):
            raise TypeError(
                f"DryFriction: kinetic must be callable, got {self.kinetic!r}; a constant one is mu_coulomb"
            )
        if self.stribeck_velocity is not None:
            raise ValueError("DryFriction: give either kinetic or stribeck_velocity, not both")
        try:
            at_rest = self.kinetic(0.0)
        except Exception as error:
            raise ValueError(f"DryFriction: kinetic(0) raised {error!r}; it must be defined at rest") from error
        if isinstance(at_rest, np.ndarray) and at_rest.size == 1:
            at_rest = as_number(at_rest)  # interpolators of scipy return arrays of one number
        at_rest = finite(at_rest, "DryFriction: kinetic(0)")
        # one curve for both directions: at rest it may exceed neither static coefficient
        side, suffix = (1, "") if self.mu_s(1) <= self.mu_s(-1) else (-1, "_backward")
        if not 0 <= at_rest <= self.mu_s(side) * (1 + _ROUNDOFF):
            raise ValueError(
                f"DryFriction: kinetic(0) = {at_rest:g} must lie between 0 and mu_static{suffix} = {self.mu_s(side):g}"
            )

    def mu_s(self, direction: int) -> float:
        """Return the static coefficient for slip in `direction` (-1 or +1)."""
        backward = self.mu_static_backward
        return self.mu_static if direction > 0 or backward is None else backward

    def mu_c(self, direction: int) -> float:
        """Return the Coulomb coefficient for slip in `direction` (-1 or +1)."""
        backward = self.mu_coulomb_backward
        return self.mu_coulomb if direction > 0 or backward is None else backward

    @property
    def core(self) -> DryFriction:
        """The law itself."""
        return self

    @property
    def character(self) -> Character:
        """Exact sticking."""
        return Character(sticks=True, velocity_dependent="a kinetic curve" if self.curved else "")

    @property
    def curved(self) -> bool:
        """Whether the kinetic coefficient depends on speed."""
        return self.stribeck_velocity is not None or self.kinetic is not None

    def mu_k(self, speed: float, direction: int) -> float:
        """Return the kinetic coefficient at `speed` >= 0 for slip in `direction`."""
        return float(Kinetic([self], np.array([direction < 0]))(np.array([speed]))[0])

    def mu_k_slope(self, speed: float, direction: int) -> float:
        """Return the derivative of the kinetic coefficient with respect to speed."""
        kinetic, w = Kinetic([self], np.array([direction < 0])), np.array([speed])
        return float((kinetic.slope(w) + kinetic.slope_cut(w))[0])

    def least(self, direction: int) -> float:
        """Return the static coefficient just after sticking, from which it rises with the dwell."""
        if self.stribeck_velocity is not None:
            return self.mu_s(direction)
        return max(self.mu_c(direction), 0.0 if self.kinetic is None else self.kinetic_at(0.0))

    def kinetic_at(self, speed: float) -> float:
        """Return the value of `kinetic`; a `CurveError` says where it is no valid coefficient."""
        assert self.kinetic is not None
        try:
            value = self.kinetic(speed)
        except Exception as error:
            raise CurveError(self, f"kinetic({speed:g}) raised {error!r}; return a number") from error
        mu = value if type(value) is float else as_number(value)
        if not 0 <= mu < math.inf:
            raise CurveError(self, f"kinetic({speed:g}) = {value!r}; return a finite number, at least 0")
        return mu

    def self_energised(self, gain: float) -> DryFriction:
        """Return the law of a contact that friction presses on or off: ``N = N0 + gain r``.

        Slipping in direction ``s`` with ``r = s mu N`` it has ``r = s mu N0 / (1 - s mu gain)``: forward and backward
        coefficients differ, and N0 is the normal force to give. The leading shoe of a drum brake has a positive gain.

        Parameters
        ----------
        gain : float
            Normal force per friction force in forward slip, N/N. For a shoe whose normal force has the lever arm b and
            whose friction force has the lever arm c it is c / b.

        Raises
        ------
        ValueError
            If ``mu gain >= 1`` on a side: the contact locks, whatever the load. Or if a coefficient depends on speed
            or a dwell time is given: then the levels are not proportional to N0 alone.
        """
        number = finite(gain, "self_energised: gain")
        if self.curved or self.dwell:
            raise ValueError(
                "self_energised: coefficients must be constant, without kinetic curve and dwell; "
                "give static and Coulomb coefficients only"
            )
        found = []
        for side in (1, -1):
            for mu in (self.mu_s(side), self.mu_c(side)):
                share = side * mu * number
                if share >= 1:
                    way = "forward" if side > 0 else "backward"
                    raise ValueError(
                        f"self_energised: with mu = {mu:g} {way} and gain {number:g} the contact locks, because "
                        f"mu gain = {share:g} is not below 1: no force turns it {way}; use OneWay for what locks"
                    )
                found.append(mu / (1 - share))
        return DryFriction(found[0], found[1], mu_static_backward=found[2], mu_coulomb_backward=found[3])


def law_from_dict(data: Any, what: str) -> Law:
    """Return the law that `Law.to_dict` wrote; refuse other data with a message that begins with `what`."""
    if not isinstance(data, Mapping):
        raise TypeError(f"{what}: a law is a table with its type and coefficients, got {data!r}")
    values = dict(data)
    kind = values.pop("type", "DryFriction")
    if not isinstance(kind, str) or kind not in _MAKERS:
        raise ValueError(f"{what}: unknown law type {kind!r}; known are {', '.join(_MAKERS)}")
    if "kinetic" in values:
        raise ValueError(f"{what}: a kinetic curve is code and cannot stand in a file; use stribeck_velocity")
    check_entries(_MAKERS[kind], kind, values, what, TypeError, code=("kinetic",))
    if "law" in values:
        values["law"] = law_from_dict(values["law"], what)
    try:
        return _MAKERS[kind](**values)
    except (TypeError, ValueError) as error:
        raise type(error)(f"{what}: {error}") from None
