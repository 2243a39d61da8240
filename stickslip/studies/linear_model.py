"""Linear models of a scene in its current modes: ``x' = A x + B u``, ``y = C x + D u`` for small deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Complex, Indices
from stickslip.model.checks import finite, names
from stickslip.model.elements import Force
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.simulation.simulate import simulate

_AHEAD = 1e-6  # time in s that is simulated to find the modes
_ROUNDOFF = 1e2 * np.finfo(float).eps  # error of a matrix as a part of its size
_AT_CORNER = 1e-9  # part of its size within which a quantity is at a corner of a force


@dataclass(frozen=True, eq=False)
class LinearModel:
    """``x' = A x + B u``, ``y = C x + D u`` for small deviations from a motion in fixed modes.

    Attributes
    ----------
    A, B, C, D : array
        Of shapes (states, states), (states, inputs), (outputs, states), (outputs, inputs).
    states : tuple of str
        ``"velocity(body)"`` of bodies whose velocity does not follow from others, ``"position(body)"`` of those whose
        position a force reads, ``"deflection(contact)"`` of bristles, ``"state(block, number)"`` of blocks. Positions
        that closed stops fix are no states.
    inputs : tuple of str
        ``"force(body)"``, ``"normal(contact)"`` of contacts whose normal force is a load, ``"velocity(drive)"`` and
        ``"acceleration(drive)"``.
    outputs : tuple of str
        ``"velocity(body)"``, ``"position(body)"``, ``"relative_velocity(row)"`` and ``"force(row)"``.
    modes : dict of str to Mode
        The modes in which it holds. Stuck contacts are constraints.
    t : float
        Time in s at which it holds, where loads change.
    """

    A: Array = field(repr=False)
    B: Array = field(repr=False)
    C: Array = field(repr=False)
    D: Array = field(repr=False)
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    modes: dict[str, Mode]
    t: float

    @property
    def eigenvalues(self) -> Complex:
        """Eigenvalues of A in 1/s, the least stable first."""
        return self._spectrum[0]

    @property
    def frequencies(self) -> Array:
        """Angular frequencies in rad/s of the oscillating eigenvalues, each once, in the order of these."""
        found, rough = self._spectrum
        return np.asarray(found.imag[found.imag > rough])

    @property
    def stable(self) -> bool:
        """Whether no deviation grows: no eigenvalue has a positive real part, but for its roundoff."""
        found, rough = self._spectrum
        return bool(np.all(found.real <= rough))

    @cached_property
    def _spectrum(self) -> tuple[Complex, Array]:
        """The eigenvalues, and the roundoff of each: an error e of A moves an eigenvalue by ``e / |y^H x|``.

        x and y are its right and its left eigenvector, of length 1. For a double eigenvalue these are nearly orthogonal
        (Golub and Van Loan 2013, section 7.2.2).
        """
        if not self.A.size:
            return np.zeros(0, dtype=complex), np.zeros(0)
        # in units of the states in which rows and columns are of the same size
        balanced, _ = scipy.linalg.matrix_balance(self.A, permute=False)
        found, left, right = scipy.linalg.eig(balanced, left=True, right=True)
        error = _ROUNDOFF * float(np.linalg.norm(balanced))
        across = np.abs(np.sum(left.conj() * right, axis=0))
        rough = error / np.maximum(across, _ROUNDOFF ** (2 / 3))
        order = np.lexsort((found.imag, -found.real))
        return np.asarray(found[order], dtype=complex), np.asarray(rough[order])

    def select(self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None) -> LinearModel:
        """Return the model with some of its inputs and outputs only, in the order given.

        Raises
        ------
        ValueError
            If there is no such input or output.
        """
        columns = _places(self.inputs, inputs, "input")
        rows = _places(self.outputs, outputs, "output")
        return replace(
            self,
            B=self.B[:, columns],
            C=self.C[rows],
            D=self.D[np.ix_(rows, columns)],
            inputs=tuple(self.inputs[k] for k in columns),
            outputs=tuple(self.outputs[k] for k in rows),
        )

    def to_scipy(self) -> Any:
        """Return it as a `scipy.signal.StateSpace`."""
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """Return it as a `control.StateSpace` of python-control, with names.

        Raises
        ------
        ImportError
            If python-control is not installed.
        """
        try:
            import control
        except ImportError as missing:
            raise ImportError("to_control needs python-control: pip install control") from missing
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.A, self.B, self.C, self.D, **names)

    def __str__(self) -> str:
        """Return modes and eigenvalues."""
        shown = ", ".join(f"{name} {mode.name}" for name, mode in self.modes.items())
        lines = [f"linear model at t = {self.t:g} s, modes: {shown or 'none'}"]
        lines.append(f"states: {', '.join(self.states)}")
        for one in self.eigenvalues:
            lines.append(f"eigenvalue {one.real:.9g} {one.imag:+.9g}i 1/s")
        return "\n".join(lines)


def _places(known: tuple[str, ...], wanted: Sequence[str] | None, what: str) -> list[int]:
    if wanted is None:
        return list(range(len(known)))
    wanted = names(wanted, f"LinearModel.select: {what}s")
    for name in wanted:
        if name not in known:
            raise ValueError(f"LinearModel.select: no {what} is called {name!r}; known are {', '.join(known)}")
    return [known.index(name) for name in wanted]


def linearize(scene: Scene, *, t: float = 0.0) -> LinearModel:
    """Return the linear model of a scene at its start, in the modes in which it starts.

    Stuck contacts, ties and locked clutches are constraints: bodies whose velocities follow from others are no states.
    Forces of slipping contacts depend on velocities through the slope of their kinetic curve, and on the state
    wherever a normal force does: squeal by mode coupling is an eigenvalue with a positive real part.

    Parameters
    ----------
    scene : Scene
        It is linearized about its velocities and positions at the start. Only where these are a steady state does the
        model hold for longer than a moment.
    t : float
        Time in s at which loads are read.

    Raises
    ------
    TypeError, ValueError
        If an argument is not usable.
    SimulationError
        If the scene has no consistent modes.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"linearize: scene must be a Scene, got {type(scene).__name__}")
    t = finite(t, "linearize: t")
    probes = [Force(body.name, 0.0) for body in scene.bodies]
    probed = Scene(*scene.elements, *probes, motion=scene.motion)
    ahead = max(_AHEAD, 1e3 * float(np.spacing(abs(t))))
    result = simulate(probed, (t, t + ahead), max_step=ahead)
    trajectory = result.trajectory
    motion, system = trajectory.motion(0), trajectory.system
    if system.sampled:
        raise ValueError("linearize: sampled blocks have no linear model in continuous time; leave them out")
    _check_corners(motion)
    labels = trajectory.pieces[0].labels.tolist()
    modes = {row.name: Mode(k) for row, k in zip(system.rows, labels, strict=True) if row.kind != "tie"}
    names, to_states, chosen = _states(system, motion)
    inputs, columns = _inputs(scene, system)
    unit = np.zeros((system.inputs_and_dwells, len(columns)))
    unit[columns, np.arange(len(columns))] = 1.0
    held = motion.equations.consistent(np.zeros((system.size, len(columns))), system.drive_velocities(unit))
    by_inputs = _response(motion, held, motion.input_changes(held, unit))
    by_states = _response(motion, to_states, motion.input_changes(to_states, np.zeros((len(unit), len(chosen)))))
    outputs, (C, D) = _outputs(motion, [(to_states, by_states), (held, by_inputs)])
    A, B = by_states.rates[chosen], by_inputs.rates[chosen]
    return LinearModel(A, B, C, D, names, inputs, outputs, modes, t)


def _states(system: System, motion: Motion) -> tuple[tuple[str, ...], Array, Indices]:
    """Return the names of the model's states, how all states of the scene follow from them, and their places there."""
    n, size = system.n, system.size
    fixed, by_others = _fixed_positions(system, motion)
    chosen = np.setdiff1d(np.arange(size), [*motion.equations.dependent, *fixed])
    to_states = np.zeros((size, chosen.size))
    to_states[chosen, np.arange(chosen.size)] = 1.0
    to_states[fixed] = by_others @ to_states
    to_states = motion.equations.consistent(to_states, np.zeros((system.drives, chosen.size)))
    bodies = [*system.scene.bodies, *system.scene.drives]
    names = {i: f"velocity({bodies[i].name})" for i in range(n)}
    names |= {k: f"position({bodies[i].name})" for i, k in system.position_state.items()}
    names |= {k: f"deflection({system.rows[row].name})" for row, k in system.bristle_state.items()}
    for name, place in system.blocks.items():
        names |= {k: f"state({name}, {k - place.first})" for k in range(place.first, place.end)}
    return tuple(names[k] for k in chosen.tolist()), to_states, chosen


def _fixed_positions(system: System, motion: Motion) -> tuple[Indices, Array]:
    """Return the places of positions that follow from others because stops are closed, and the map from these."""
    closed = (motion.equations.is_held & system.is_stop).nonzero()[0]
    lines = np.zeros((closed.size, system.size))
    if not closed.size:
        return closed, lines
    coefficients = np.hstack([dense(system.G[closed]), dense(system.D[closed])])
    lines[:, system.n : system.first_bristle] = coefficients[:, system.placed]
    _, parts, order = scipy.linalg.qr(lines, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(parts))
    rank = int(np.count_nonzero(sizes > 1e-12 * sizes.max()))
    fixed = order[:rank]
    by_others = -np.linalg.lstsq(lines[:, fixed], lines, rcond=None)[0]
    by_others[:, fixed] = 0.0
    return fixed, by_others


def _check_corners(motion: Motion) -> None:
    """Refuse a state at a corner of a force: there are two linear models, one for each side."""
    system, dependence = motion.system, motion.system.dependence
    q = motion.inputs(0.0, motion.y)[: system.inputs]
    if dependence is not None and dependence.tables:
        for k, x in enumerate(dependence.looked_up(q, motion.y).tolist()):
            region = dependence.region(k, x)
            for border in dependence.borders(k, region):
                if np.isfinite(border) and abs(x - border) <= _AT_CORNER * (abs(x) + abs(border)):
                    raise ValueError(
                        f"linearize: a table is read at its corner {border:g}, where its slope changes: there is a "
                        "model for each side; start the scene a little beside it"
                    )
    if dependence is not None:
        sizes = dependence.normal_majorants(np.abs(q), motion.state_majorants)[: system.m]
        zero = system.pressed & (np.abs(q[: system.m]) <= _AT_CORNER * sizes)
        if zero.any():
            # a normal force that stays 0 near by, as that of an open gap, has no corner there
            zero &= motion.input_slopes(0.0, motion.y)[: system.m].any(axis=1)
        for j in zero.nonzero()[0].tolist():
            raise ValueError(
                f"linearize: the normal force of contact {system.rows[j].name!r} is just 0, where its friction has a "
                "corner: there is a model for each side; start the scene a little beside it"
            )
    functions, equations = system.piecewise, motion.equations
    if not functions.count:
        return
    depth = (functions.border_y @ motion.y + functions.border_q @ q)[equations.borders]
    size = equations.border_majorants(motion.state_majorants, np.abs(q))
    for i in (np.abs(depth) <= _AT_CORNER * size).nonzero()[0].tolist():
        label = functions.labels[functions.owner[equations.borders[i]]]
        raise ValueError(
            f"linearize: {label} is just at its limit, where its force has a corner: there is a model for each side; "
            "start the scene a little beside it"
        )


def _inputs(scene: Scene, system: System) -> tuple[tuple[str, ...], list[int]]:
    """Return names and places of the inputs."""
    names, places = [], []
    first = system.first_force + len(scene.forces)
    for k, body in enumerate(scene.bodies):
        names.append(f"force({body.name})")
        places.append(first + k)
    for j in (system.is_friction & ~system.pressed).nonzero()[0].tolist():
        names.append(f"normal({system.rows[j].name})")
        places.append(j)
    for what, first in (("velocity", system.first_drive), ("acceleration", system.first_acceleration)):
        for k, drive in enumerate(scene.drives):
            names.append(f"{what}({drive.name})")
            places.append(first + k)
    return tuple(names), places


class _Response(NamedTuple):
    """Effects of small changes, a column each, on rates of states, relative velocities and forces of the rows."""

    rates: Array
    relative: Array
    forces: Array


def _response(motion: Motion, dy: Array, dq: Array) -> _Response:
    """Return the effects of changes `dy` of the states and `dq` of the inputs."""
    equations, size, m = motion.equations, motion.system.size, motion.system.m
    found = equations.apply(dy) + equations.respond(dq)
    rows, relative = equations.velocity_dependent, found[size : size + m]
    forces = np.asarray(equations.friction @ dq)
    forces[equations.elastic] = equations.elastic_forces(dy, dq)
    if rows.size:
        law, terms = equations.law, motion.law_arguments(0.0, motion.y)
        w, normal, _, z = terms
        of_normal, rates_of_normal = law.by_normal(*terms)
        own = rows[law.bristles]
        slopes = law.slopes(*terms) + law.slope_cut(w, normal)
        change = slopes[:, None] * relative[rows] + of_normal[:, None] * dq[rows]
        if own.size:
            places = equations.bristle_places
            change[law.bristles] += law.by_bristle(w, normal, z)[:, None] * dy[places]
        found = found + equations.push(change)
        if own.size:
            by_w, by_z = law.bristle_slopes(w, normal, z)
            found[places] = by_w[:, None] * relative[own] + by_z[:, None] * dy[places]
            found[places] += rates_of_normal[:, None] * dq[own]
        forces[rows] = change
    forces[equations.held] = found[size + m : size + m + equations.held.size]
    return _Response(found[:size], relative, forces)


def _outputs(motion: Motion, changes: list[tuple[Array, _Response]]) -> tuple[tuple[str, ...], list[Array]]:
    """Return names of the outputs, and how they follow from changes of states and of inputs."""
    system = motion.system
    n = system.n
    names = [f"velocity({body.name})" for body in system.scene.bodies]
    names += [f"position({system.scene.bodies[i].name})" for i in system.moved]
    names += [f"relative_velocity({row.name})" for row in system.rows]
    names += [f"force({row.name})" for row in system.rows]
    return tuple(names), [
        np.concatenate([dy[:n], dy[system.moved_state], response.relative, response.forces]) for dy, response in changes
    ]
