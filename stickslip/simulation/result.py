"""What a simulation computed: data, and the quantities read off it by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.model.arrays import Array
from stickslip.model.checks import whole
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results.continuation import final_scene
from stickslip.results.outcome import Outcome
from stickslip.results.readable import times_within
from stickslip.results.samples import Samples, for_reading
from stickslip.results.sampling import fit_for_plot, refined
from stickslip.results.trajectory import NOTHING_KEPT
from stickslip.simulation.presented import Presented


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

    def __reduce__(self) -> tuple[Any, ...]:
        """Let it come back from another process with all that it hands over."""
        return type(self), (*self.args, self.t, self.modes, self.result), self.__dict__


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

    def __reduce__(self) -> tuple[Any, ...]:
        """Let it come back from another process with all that it hands over."""
        return type(self), (*self.args, self.result), self.__dict__


@dataclass(frozen=True, eq=False)
class Result(Outcome, Presented):
    """A simulated motion, in the manner of scipy's `solve_ivp`; ``result(t)`` are the states at any times `t` in s.

    Attributes
    ----------
    scene : Scene
    events : list of Event
        In order of time.
    success : bool
        Whether the run came to its end, or to a `When` that stops it.
    status : int
        0 where the end was reached, 1 where a `When` stopped the run, -1 where it failed or was interrupted.
    message : str
        The same in words.
    stats : dict
        ``"engine"``, and counts: ``"states"``, the ``"guards"`` at most at a time, ``"restarts"`` (motions begun after
        the first), ``"steps"``, ``"function_calls"`` of feedback, and others of the work done.
    trajectory : Trajectory
        The motion, piece by piece.
    """

    @property
    def t(self) -> Array:
        """Times in s, shape (n,).

        They are `t_eval`; or the steps of a fixed-step method; or so close that straight lines between them are right
        to 1e-3 of each quantity's range. Without `t_eval` every event stands twice (left and right limit).
        """
        return for_reading(self.samples.t.view())

    @property
    def y(self) -> Array:
        """States, shape (size, n): velocities, positions that springs or quantities read, bristles, blocks."""
        return for_reading(self.samples.y.view())

    @property
    def nfev(self) -> int:
        """Number of rate evaluations."""
        return int(self.stats["rate_calls"])

    @property
    def njev(self) -> int:
        """Number of Jacobian evaluations."""
        return int(self.stats["jacobian_calls"])

    @property
    def runs(self) -> tuple[Result]:
        """The runs of which this is made: itself."""
        return (self,)

    @property
    def is_dense(self) -> bool:
        """Whether the motion between the outputs was kept, or there is none."""
        return self.trajectory.is_dense or not self.trajectory.pieces

    def _read(self, read: Callable[[Samples, str], NDArray[Any]], name: str) -> NDArray[Any]:
        return read(self.samples, name)

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
        if given.dtype.kind not in "iuf" or given.ndim > 1:
            raise TypeError(f"a result is called with times in s, got {t!r}; give a number, or numbers in one line")
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
        if not self.trajectory.pieces:
            raise ValueError(f"sample: {NOTHING_KEPT}")
        wanted = times_within(times, self.trajectory.starts[0], self.trajectory.stops[-1])
        return replace(self, _at=Samples.at_times(self.trajectory, wanted))

    def fit_for_plot(self, points: int = 0) -> Result:
        """Return the same result at times between which straight lines look like the motion, events twice.

        Parameters
        ----------
        points : int
            About how many evenly spaced times to add.
        """
        whole(points, "fit_for_plot: points")
        if not self.trajectory.is_dense:
            return self
        if points not in self._fit:
            at = refined(self.trajectory, points) if points else fit_for_plot(self.trajectory)
            self._fit[points] = replace(self, _at=at)
        return self._fit[points]

    @cached_property
    def _fit(self) -> dict[int, Result]:
        """What was found fit for a plot, by the number of times: all panels of a figure ask for the same."""
        return {}

    def final_scene(self) -> Scene:
        """Return the scene at the end of the motion, from which `simulate` goes on.

        Velocities, positions, times at rest, bristles, slip states, states of blocks and sample clocks are those of the
        end. Loads stay as they are: simulate over a time span that starts where this one ends. The motion goes on as it
        would have, but a change of mode at the very end may be noted by neither run: let runs end between events. A
        sample at the very end is taken again by the second run, with what signals jump to there.

        Raises
        ------
        ValueError
            If nothing was computed, or only the requested outputs were kept.
        """
        return final_scene(self.trajectory)

    def __str__(self) -> str:
        lines = [self.message, *map(str, self.events)]
        lines.append(", ".join(f"{name}: {value}" for name, value in self.stats.items()))
        return "\n".join(lines)
