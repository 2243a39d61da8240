"""Quantities of a simulated motion, read by name: of one run, or of several in a row."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from stickslip.model.arrays import Array, Modes
from stickslip.model.checks import numbers, whole
from stickslip.model.scene import Scene
from stickslip.results.outcome import Event, Outcome
from stickslip.results.pickled import PickledByFields
from stickslip.results.samples import Samples


class Readable(PickledByFields):
    """A motion that is read by name at the times `t`."""

    if TYPE_CHECKING:  # subclasses define these, partly as fields

        @property
        def runs(self) -> Sequence[Outcome]:
            """The runs that make up the motion, in order of time."""

        @property
        def scene(self) -> Scene:
            """What was simulated."""

        @property
        def events(self) -> list[Event]:
            """Events in order of time."""

        @property
        def message(self) -> str:
            """How it ended, in words."""

        @property
        def is_dense(self) -> bool:
            """Whether the motion between the outputs was kept."""

        @property
        def t(self) -> Array:
            """Times in s."""

        def energy(self) -> Any:
            """Return the energy ledger."""

        def sample(self, times: int | Array) -> Self:
            """Return the same motion at other times, or at a number of evenly spaced ones."""

        def fit_for_plot(self, points: int = 0) -> Self:
            """Return the same motion at times between which straight lines look like it."""

    def _read(self, read: Callable[[Samples, str], NDArray[Any]], name: str) -> NDArray[Any]:
        """Return at the times `t` the quantity that `read` takes from samples, for the element with a name."""
        raise NotImplementedError

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive at the times `t`, in m/s or rad/s, shape (n,).

        The velocity of a body that is held to a drive equals the drive's to the bit.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        return self._read(Samples.velocity, body)

    def position(self, body: str) -> Array:
        """Return the position of a body or drive at the times `t`, in m or rad, shape (n,).

        ``x = x_0 + integral of v dt``. Where the position is no state, the polynomials of the steps are integrated
        exactly, and velocities of drives by Gauss quadrature.

        Raises
        ------
        ValueError
            If there is no such body, or its position was not kept.
        """
        return self._read(Samples.position, body)

    def force(self, contact: str) -> Array:
        """Return the force r of a contact or another row at the times `t`, in N or N m, shape (n,).

        ``-radius_a r`` acts on its body a and ``+radius_b r`` on b; of a tie with coefficients c, ``-c_i r`` on body i.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(Samples.force, contact)

    def breakaway(self, contact: str, direction: int | None = None) -> Array:
        """Return a breakaway level B of a contact at the times `t`, in N or N m, never negative.

        ``B = mu_s N``, or ``B = (mu_s - (mu_s - mu_c) exp(-(t - t_start)/tau)) N`` with a dwell time tau (Breedveld
        2000, eqs. 8 and 9). A stuck contact holds forces from ``-breakaway(contact, -1)`` to
        ``+breakaway(contact, +1)``; the two differ where forward and backward coefficients do. While the contact slips
        they are the levels with which it would begin to stick.

        Parameters
        ----------
        contact : str
            Name of the contact.
        direction : +1 or -1, optional
            +1 (`Mode.FORWARD`) for the level above which it slips forward, -1 (`Mode.BACKWARD`) for the other. By
            default the level on the side of the force: that of the direction in which the contact slips, or, while
            it is stuck, of the sign of its force.

        Raises
        ------
        ValueError
            If there is no such contact or direction.
        """
        if direction is None:
            return self._read(Samples.breakaway, contact)
        if isinstance(direction, bool) or not isinstance(direction, (int, np.integer)) or direction not in (1, -1):
            raise ValueError(
                f"breakaway of contact {contact!r}: direction must be +1 (forward) or -1 (backward), "
                f"got {direction!r}; leave it out for the side of the force"
            )
        return self._read(Samples.backward_level if direction < 0 else Samples.forward_level, contact)

    def mode(self, contact: str) -> Modes:
        """Return the mode of a contact or another row at the times `t`: -1, 0, +1, or 2 where a gap or stop is open.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(Samples.mode, contact)

    def relative_velocity(self, contact: str) -> Array:
        """Return ``w = radius_a v_a - radius_b v_b`` of a contact or another row at the times `t`, in m/s or rad/s.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(Samples.relative_velocity, contact)

    def stretch(self, contact: str) -> Array:
        """Return the stretch ``radius_a x_a - radius_b x_b`` of a row at the times `t`, in m or rad.

        Raises
        ------
        ValueError
            If there is no such row, or the position of one of its bodies was not kept.
        """
        return self._read(Samples.stretch, contact)

    def power(self, contact: str) -> Array:
        """Return the power ``r w`` that a contact dissipates at the times `t`, in W.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(Samples.power, contact)

    def normal(self, contact: str) -> Array:
        """Return the normal force of a contact at the times `t`, in N; 0 where it is open, and of other rows.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(Samples.normal, contact)

    def state(self, block: str) -> Array:
        """Return the states of a block at the times `t`.

        Parameters
        ----------
        block : str
            Name of a block.

        Returns
        -------
        array (n,) or (states, n)
            The first where the block has one state.

        Raises
        ------
        ValueError
            If there is no such block.
        """
        found = self._read(Samples.states_of, block)
        return found[0] if found.shape[0] == 1 else found

    def output(self, block: str) -> Array:
        """Return the outputs of a block at the times `t`.

        Parameters
        ----------
        block : str
            Name of a block.

        Returns
        -------
        array (n,) or (outputs, n)
            The first where the block has one output.

        Raises
        ------
        ValueError
            If there is no such block.
        """
        found = self._read(Samples.outputs_of, block)
        return found[0] if found.shape[0] == 1 else found


def times_within(times: int | Sequence[float] | Array, start: float, stop: float) -> Array:
    """Return the times at which to sample: those given, or evenly spaced ones where `times` is their number."""
    if isinstance(times, (int, np.integer)) and not isinstance(times, bool):
        return np.linspace(start, stop, whole(times, "sample: number of times", 2))
    if not isinstance(times, Iterable) or isinstance(times, str):
        raise TypeError(f"sample: give times or their number, got {times!r}")
    return numbers(times, "sample: times")


def check_result(result: Any, what: str) -> None:
    """Raise a TypeError unless `result` is the result of a simulation.

    `what` begins the message.
    """
    if not isinstance(result, Readable):
        raise TypeError(f"{what}: expected a Result, got {type(result).__name__}; simulate(scene, t_span) returns one")
