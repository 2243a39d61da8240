"""What a simulation computed: data, and the quantities read off it by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results import energy, files, shares
from stickslip.results.continuation import final_scene
from stickslip.results.explanations import explain_result
from stickslip.results.outcome import Event
from stickslip.results.samples import Samples
from stickslip.results.sampling import at_steps, fit_for_plot, refined
from stickslip.results.trajectory import Trajectory

if TYPE_CHECKING:
    from stickslip.plots import Figure

__all__ = ["Event", "Result", "SimulationError", "SimulationInterrupted", "load"]

_MOST_TIMES = 100_000_000

Array = NDArray[np.float64]
Target = str | PathLike[str]


class SimulationError(RuntimeError):
    """A simulation that could not go on.

    Attributes
    ----------
    t : float
        Time in s that was reached.
    modes : dict
        The mode of each contact then.
    result : Result
        All that was computed so far.
    """

    def __init__(self, message: str, t: float, modes: Mapping[str, Mode], result: Result) -> None:
        super().__init__(message)
        self.t, self.modes, self.result = t, dict(modes), result


class SimulationInterrupted(KeyboardInterrupt):
    """A simulation that was interrupted from the keyboard.

    Attributes
    ----------
    result : Result
        All that was computed so far.
    """

    def __init__(self, message: str, result: Result) -> None:
        super().__init__(message)
        self.result = result


@dataclass(frozen=True)
class Result:
    """A simulated motion, in the manner of scipy's `solve_ivp`.

    Attributes
    ----------
    scene : Scene
    events : list of Event
        In order of time.
    success : bool
    status : int
        0 where the end was reached, -1 where not.
    message : str
    stats : dict
        What was assembled and how much work was done.
    trajectory : Trajectory
        The motion, piece by piece.
    """

    scene: Scene
    events: list[Event]
    success: bool
    status: int
    message: str
    stats: dict[str, Any]
    trajectory: Trajectory = field(repr=False)
    _at: Samples | Array | None = field(repr=False)

    @cached_property
    def samples(self) -> Samples:
        """The motion at the times `t`."""
        if isinstance(self._at, Samples):
            return self._at
        if self._at is None:
            is_stepped = self.trajectory.span[2]
            return at_steps(self.trajectory) if is_stepped else fit_for_plot(self.trajectory)
        return Samples.at_times(self.trajectory, self._at)

    @property
    def t(self) -> Array:
        """Times in s, shape (n,).

        They are `t_eval`; or the steps of a fixed-step method; or so close that straight lines between them are right
        to 1e-3 of each quantity's range. But with `t_eval` every event stands twice (left and right limit).
        """
        return self.samples.t

    @property
    def y(self) -> Array:
        """States, shape (size, n): velocities of the bodies, positions of what springs touch, bristles."""
        return self.samples.y

    @property
    def nfev(self) -> int:
        """Number of rate evaluations."""
        return int(self.stats["rate_calls"])

    @property
    def njev(self) -> int:
        """Number of Jacobian evaluations."""
        return int(self.stats["jacobian_calls"])

    # -- by name ------------------------------------------------------------------------------------------

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive at the times `t`, in m/s or rad/s.

        The velocity of a body held to a drive equals the drive's to the bit.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        return self.samples.velocity(body)

    def position(self, body: str) -> Array:
        """Return the position of a body or drive at the times `t`, in m or rad.

        ``x = x_0 + integral of v dt`` by Gauss quadrature where no spring made it a state.

        Raises
        ------
        ValueError
            If there is no such body, or its position was not kept.
        """
        i = self.samples.body(body)
        placed = (
            i in self.samples.system.position_state or i >= self.samples.system.n + self.samples.system.drives
        )
        if not (placed or self.trajectory.is_dense) and self.trajectory.pieces:
            raise ValueError(
                f"the position of {body!r} was not kept; simulate with dense_output=True, "
                "or let a spring touch the body"
            )
        return self.samples.position(body)

    def force(self, contact: str) -> Array:
        """Return the friction force r of a contact at the times `t`, in N or N m (-r acts on its body a).

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self.samples.force(contact)

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
            return self.samples.breakaway(contact)
        if not isinstance(direction, (int, np.integer)) or direction not in (1, -1):
            raise ValueError(
                f"breakaway of contact {contact!r}: direction must be +1 (forward) or -1 (backward), "
                f"got {direction!r}; leave it out for the side of the force"
            )
        return self.samples.levels(contact)[0 if direction == 1 else 1]

    def mode(self, contact: str) -> NDArray[np.int8]:
        """Return the mode of a contact at the times `t`: -1, 0 or +1.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self.samples.mode(contact)

    def relative_velocity(self, contact: str) -> Array:
        """Return ``w = v_a - v_b`` of a contact at the times `t`, in m/s or rad/s.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self.samples.relative_velocity(contact)

    def stretch(self, contact: str) -> Array:
        """Return the stretch ``radius_a x_a - radius_b x_b`` of a row at the times `t`, in m or rad.

        Raises
        ------
        ValueError
            If there is no such row.
        """
        return self.samples.stretch(contact)

    def power(self, contact: str) -> Array:
        """Return the power ``r w`` that a contact dissipates at the times `t`, in W.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self.force(contact) * self.relative_velocity(contact)

    def normal(self, contact: str) -> Array:
        """Return the normal force of a contact at the times `t`, in N, zero where it is open.

        Raises
        ------
        ValueError
            If there is no such contact.
        """
        return self.samples.normal(contact)

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
        found = self.samples.states_of(block)
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
        found = self.samples.outputs_of(block)
        return found[0] if found.shape[0] == 1 else found

    # -- between and beyond -------------------------------------------------------------------------------

    def __call__(self, t: float | Sequence[float] | Array) -> Array:
        """Return the states at any times of the simulated span, right limits at events.

        Parameters
        ----------
        t : float or array (k,)
            Times in s.

        Returns
        -------
        array (size,) or (size, k)

        Raises
        ------
        ValueError, TypeError
            If `t` is no time, a time lies outside, or only the requested outputs were kept.
        """
        given = np.asarray(t)
        if given.dtype.kind not in "iuf":
            raise TypeError(f"a result is called with times in s, got {t!r}; give numbers")
        times = np.atleast_1d(given.astype(float))
        states = Samples.at_times(self.trajectory, times).y
        return states[:, 0] if np.ndim(t) == 0 else states

    def sample(self, times: int | Sequence[float] | Array) -> Result:
        """Return the same result at other times: right limits at events, as with `t_eval`.

        Parameters
        ----------
        times : int or array (k,)
            Times in s within the simulated span, or how many evenly spaced ones.

        Raises
        ------
        ValueError, TypeError
            If a time lies outside, or only the requested outputs were kept.
        """
        if isinstance(times, (int, np.integer)) and not isinstance(times, bool):
            if times < 2:
                raise ValueError(f"sample: give at least 2 times, got {times}")
            if times > _MOST_TIMES:
                raise ValueError(f"sample: give at most {_MOST_TIMES} times, or times of your own choice")
            if not self.trajectory.pieces:
                raise ValueError("sample: nothing was computed")
            times = np.linspace(self.trajectory.starts[0], self.trajectory.stops[-1], int(times))
        try:
            wanted = np.array(times, dtype=float)
        except (TypeError, ValueError):
            raise TypeError(f"sample: give times or their number, got {times!r}") from None
        if wanted.ndim != 1:
            raise ValueError(f"sample: give times in one line, got an array of shape {wanted.shape}")
        return replace(self, _at=Samples.at_times(self.trajectory, wanted))

    def fit_for_plot(self, points: int = 0) -> Result:
        """Return the same result at times between which straight lines look like the motion, events twice.

        Parameters
        ----------
        points : int
            About how many evenly spaced times to add.
        """
        if not self.trajectory.is_dense:
            return self
        at = refined(self.trajectory, points) if points else fit_for_plot(self.trajectory)
        return replace(self, _at=at)

    def final_scene(self) -> Scene:
        """Return the scene at the end of the motion, from which `simulate` goes on.

        Velocities, positions, times at rest, bristles, slip states, states of blocks and sample clocks are those of the
        end. Loads stay as they are: simulate over a time span that starts where this one ends.

        Raises
        ------
        ValueError
            If nothing was computed, or only the requested outputs were kept.
        """
        return final_scene(self.trajectory)

    def energy(self) -> energy.EnergyLedger:
        """Return where the energy went, and by how much the balance is off: a free check of accuracy.

        Raises
        ------
        ValueError
            If only the requested outputs were kept.
        """
        return energy.energy(self)

    def explain(self) -> str:
        """Return in words what was assembled, which guards were watched, and why each event happened."""
        return explain_result(self)

    def to_csv(self, path: Target, *, units: bool | None = None) -> None:
        """Write motion, forces, modes, powers and energies as a table, a line per time.

        Parameters
        ----------
        path : path
        units : bool, optional
            Whether the heads of the columns say the units; by default where the scene says whether it rotates.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        files.to_csv(self, path, units=units)

    def to_frame(self) -> Any:
        """Return the same as a pandas data frame, units in ``frame.attrs["units"]`` (extra `stickslip[frames]`).

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return files.to_frame(self)

    def save(self, path: Target) -> None:
        """Write all of the result to an npz file, without loss; `stickslip.load` reads it.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        files.save(self, path)

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

        Path(path).write_text(report(self, title), encoding="utf-8")

    def _repr_html_(self) -> str:
        """Return figure, events and last velocities, as notebooks show them."""
        from stickslip.plots.notebook import result_html

        return result_html(self)

    def __str__(self) -> str:
        lines = [self.message, *map(str, self.events)]
        lines.append(", ".join(f"{name}: {value}" for name, value in self.stats.items()))
        return "\n".join(lines)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what follows from the rest."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


def load(path: Target, scene: Scene | None = None) -> Result:
    """Return the result that `Result.save` wrote: the same numbers, and `result(t)` between them.

    Parameters
    ----------
    path : path
    scene : Scene, optional
        The simulated scene, where its signals or laws are code that no file holds.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is not such a file, or the scene is missing or another one.
    """
    kept = files.read(path, scene)
    trajectory = kept.samples.trajectory
    return Result(
        trajectory.system.scene,
        kept.events,
        kept.success,
        kept.status,
        kept.message,
        dict(kept.stats),
        trajectory,
        kept.samples,
    )
