"""What is read of a simulated motion by name, drawn and written: of one run, or of several in a row."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stickslip.model.arrays import Array, Modes
from stickslip.model.checks import file_path, numbers, whole
from stickslip.model.modes import Mode
from stickslip.results import shares, tables
from stickslip.results.energy import EnergyLedger, energy
from stickslip.results.explanations import explain_result
from stickslip.results.outcome import Target
from stickslip.results.pickled import PickledByFields
from stickslip.results.samples import Samples

if TYPE_CHECKING:
    from stickslip.plots import Figure
    from stickslip.results.outcome import Drawable
else:
    # what the protocol declares would hide the fields of the classes that have them
    Drawable = object


class Readable(PickledByFields, Drawable):
    """A motion that is read by name at the times `t`."""

    def _read(self, read: Callable[[Samples], NDArray[Any]]) -> NDArray[Any]:
        """Return what is read of the samples at the times `t`."""
        raise NotImplementedError

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive at the times `t`, in m/s or rad/s.

        The velocity of a body held to a drive equals the drive's to the bit.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        return self._read(lambda samples: samples.velocity(body))

    def position(self, body: str) -> Array:
        """Return the position of a body or drive at the times `t`, in m or rad.

        ``x = x_0 + integral of v dt`` by Gauss quadrature where no spring made it a state.

        Raises
        ------
        ValueError
            If there is no such body, or its position was not kept.
        """
        return self._read(lambda samples: _position(samples, body))

    def force(self, contact: str) -> Array:
        """Return the friction force r of a contact at the times `t`, in N or N m (-r acts on its body a).

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(lambda samples: samples.force(contact))

    def breakaway(self, contact: str, direction: int | None = None) -> Array:
        """Return a breakaway level B of a contact at the times `t`, in N or N m, never negative.

        ``B = (mu_s - (mu_s - mu_c) exp(-(t - t_start)/tau)) N`` (Breedveld 2000, eqs. 8 and 9). A stuck contact holds
        forces from ``-breakaway(contact, -1)`` to ``+breakaway(contact, +1)``; the two differ where forward and
        backward coefficients do. While the contact slips they are the levels at which it would start to be stuck.

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
            return self._read(lambda samples: samples.breakaway(contact))
        if (
            isinstance(direction, bool)
            or not isinstance(direction, (int, np.integer))
            or direction not in (1, -1)
        ):
            raise ValueError(
                f"breakaway of contact {contact!r}: direction must be +1 (forward) or -1 (backward), "
                f"got {direction!r}; leave it out for the side of the force"
            )
        return self._read(lambda samples: samples.level(contact, int(direction)))

    def mode(self, contact: str) -> Modes:
        """Return the mode of a contact or another row at the times `t`: -1, 0, +1, or 2 where a gap is open.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(lambda samples: samples.mode(contact))

    def relative_velocity(self, contact: str) -> Array:
        """Return ``w = v_a - v_b`` of a contact at the times `t`, in m/s or rad/s.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(lambda samples: samples.relative_velocity(contact))

    def stretch(self, contact: str) -> Array:
        """Return the stretch ``radius_a x_a - radius_b x_b`` of a row at the times `t`, in m or rad.

        Raises
        ------
        ValueError
            If there is no such row.
        """
        return self._read(lambda samples: samples.stretch(contact))

    def power(self, contact: str) -> Array:
        """Return the power ``r w`` that a contact dissipates at the times `t`, in W.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(lambda samples: samples.power(contact))

    def normal(self, contact: str) -> Array:
        """Return the normal force of a contact at the times `t`, in N, zero where it is open.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self._read(lambda samples: samples.normal(contact))

    def share(self, contact: str) -> dict[Mode, float]:
        """Return the part of the simulated time that a contact spends in each mode; together they are 1.

        Exact where events separate the modes; where a law is smooth, the sign of the velocity is looked at 32 times in
        each step.

        Raises
        ------
        ValueError
            If there is no such contact, or the motion between the outputs was not kept.
        """
        return shares.share(self, contact)

    def state(self, block: str) -> Array:
        """Return the states of a block at the times `t`.

        Parameters
        ----------
        block : str
            Name of a block.

        Returns
        -------
        array (n,) or (states, n)
            In one line where it has one state.

        Raises
        ------
        ValueError
            If there is no such block.
        """
        found = self._read(lambda samples: samples.states_of(block))
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
            In one line where it has one output.

        Raises
        ------
        ValueError
            If there is no such block.
        """
        found = self._read(lambda samples: samples.outputs_of(block))
        return found[0] if found.shape[0] == 1 else found

    def energy(self) -> EnergyLedger:
        """Return where the energy went, and by how much the balance is off: a free check of accuracy.

        Raises
        ------
        ValueError
            If only the requested outputs were kept.
        """
        return self._ledger

    @cached_property
    def _ledger(self) -> EnergyLedger:
        return energy(self)

    def explain(self) -> str:
        """Return in words what was assembled, which guards were watched, and why each event happened."""
        return explain_result(self)

    def to_csv(self, path: Target, *, units: bool | None = None) -> None:
        """Write motion, forces, modes, powers and energies as a table, a line per time.

        Parameters
        ----------
        path : path
        units : bool, optional
            Whether the heads of the columns say the units; by default where the scene, or all its bodies, say
            whether they rotate.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        tables.to_csv(self, path, units=units)

    def to_frame(self) -> Any:
        """Return the same as a pandas data frame, units in ``frame.attrs["units"]`` (extra `stickslip[frames]`).

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return tables.to_frame(self)

    def plot(
        self,
        *,
        bodies: Sequence[str] | None = None,
        contacts: Sequence[str] | None = None,
        t_span: tuple[float, float] | None = None,
        axes: Sequence[Any] | None = None,
    ) -> Figure:
        """Draw velocities, modes, contact forces against breakaway levels, and normal forces (the paper's fig. 8).

        Parameters
        ----------
        bodies, contacts : sequence of str, optional
            Names of those to draw; by default all.
        t_span : (float, float), optional
            Part of the time to draw, in s.
        axes : sequence of matplotlib axes, optional
            Where to draw, a panel each; by default a new figure.

        Raises
        ------
        ValueError
            If there is no such body or contact.
        """
        from stickslip import plots

        return plots.overview(self, bodies=bodies, contacts=contacts, t_span=t_span, axes=axes)

    def report(self, path: Target, *, title: str = "A simulation with dry friction") -> None:
        """Write a report of the run: one HTML file that needs no other file and no network.

        It shows the scene as a schematic, motion, modes and forces, the events with their causes, the part of the time
        in each mode, the energy ledger, and what is known of the accuracy. It can be read on a phone.

        Parameters
        ----------
        path : path
        title : str
            Heading of the page.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        from stickslip.plots.report import report

        if not isinstance(title, str):
            raise TypeError(f"report: title must be a text, got {title!r}")
        file_path(path, "report").write_text(report(self, title), encoding="utf-8")

    def _repr_html_(self) -> str:
        """Return figure, events and last velocities, as notebooks show them."""
        from stickslip.plots.notebook import result_html

        return result_html(self)


def _position(samples: Samples, body: str) -> Array:
    """Return the position of a body at the times of samples; refuse one that was not kept."""
    i, system, trajectory = samples.body(body), samples.system, samples.trajectory
    placed = i in system.position_state or i >= system.n + system.drives
    if not (placed or trajectory.is_dense) and trajectory.pieces:
        raise ValueError(
            f"the position of {body!r} was not kept; simulate with dense_output=True, "
            "or let a spring touch the body"
        )
    return samples.position(body)


def times_within(times: int | Sequence[float] | Array, start: float, stop: float) -> Array:
    """Return times at which to sample: those given, or so many evenly spaced ones.

    Raises
    ------
    ValueError, TypeError
        If they are no times in one line, or fewer than 2.
    """
    if isinstance(times, (int, np.integer)) and not isinstance(times, bool):
        return np.linspace(start, stop, whole(times, "sample: number of times", 2))
    if not isinstance(times, Iterable) or isinstance(times, str):
        raise TypeError(f"sample: give times or their number, got {times!r}")
    return numbers(times, "sample: times")
