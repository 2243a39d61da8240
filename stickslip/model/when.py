"""Events of the user: a quantity of the motion comes to 0."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.checks import NamedArguments, check_name, flag
from stickslip.model.quantities import Expression, as_expression
from stickslip.model.signals import Constant, Load


@dataclass(frozen=True)
class When(metaclass=NamedArguments):
    """An event of the user: a quantity crosses 0, or comes to 0 and stays there.

    A relative velocity does the latter where its contact sticks: ``When("locked", relative_velocity("clutch"),
    stop=True)`` ends a run there. That a quantity leaves 0 again is no event. An event changes nothing in the motion;
    it is located as exactly as a change of mode, noted among the events, and may stop the simulation. A function that
    rises and falls within less than a step needs `max_step` of `simulate`.
    A quantity that is 0 where a run begins or ends has no sign there: a crossing in that instant is an event of neither
    run.

    Parameters
    ----------
    name : str
        What the event is called: `Event.contact` holds it.
    quantity : Quantity or Signal
        The quantity that crosses 0, such as ``position("m") - 0.5`` or ``feedback(function, ...)``.
    direction : int
        +1 for crossings from below only, -1 for crossings from above only, 0 for both.
    stop : bool
        Whether the simulation ends there.

    Raises
    ------
    TypeError, ValueError
        If the name is no name, the quantity no quantity, or the direction none of these.
    """

    name: str
    quantity: Expression
    _: KW_ONLY
    direction: int = 0
    stop: bool = False

    def __init__(self, name: str, quantity: Load, *, direction: int = 0, stop: bool = False) -> None:
        """Check the fields."""
        check_name(name, "When: name")
        number = isinstance(direction, (int, float)) and not isinstance(direction, bool)
        if not number or direction not in (-1, 0, 1):
            raise ValueError(f"event {name!r}: direction must be -1, 0 or +1, got {direction!r}")
        watched = as_expression(quantity, f"event {name!r}: quantity")
        if not watched.terms and isinstance(watched.signal, Constant):
            raise ValueError(
                f"event {name!r}: quantity is always {watched.signal.value:g}, so it crosses nothing; "
                "give what changes, such as position('m') - 0.5"
            )
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "quantity", watched)
        object.__setattr__(self, "direction", int(direction))
        object.__setattr__(self, "stop", flag(stop, f"event {name!r}: stop"))

    @property
    def label(self) -> str:
        """How messages name the event."""
        return f"event {self.name!r}"
