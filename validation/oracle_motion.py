"""Motion of the oracle between events: matrix exponentials where the equations are linear, DOP853 elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.integrate import DOP853

from validation.oracle_system import Array, System

State = tuple[Array, Array]
FEWEST, MOST = 60, 4000  # numbers of points at which a piece of motion is watched


def exponential(matrix: Array) -> Array:
    """Return the exponential of a matrix, from the series of exp(M / 2^k) - 1.

    This is doubled k times, and the 1 added at the end: so no digits are lost, as library routines do over many steps.
    """
    norm = float(np.abs(matrix).sum(axis=0).max())
    doublings = max(0, int(np.ceil(np.log2(norm))) + 3) if norm > 0 else 0
    term = matrix / 2.0**doublings
    part, total = term, term.copy()
    for order in range(2, 20):
        term = term @ part / order
        total += term
    for _ in range(doublings):
        total = 2 * total + total @ total
    return total + np.eye(len(matrix))


class Exponential:
    """x' = v, v' = c_0 + c_1 tau + A x + B v: y(tau) = exp(M tau) y_0 of y = (x, v, 1, tau); loads are straight lines.

    It begins at the time `start` and lasts `length` at most. `modes` are +1 or -1 of slipping contacts by number;
    those that are `opened` carry nothing, whatever the state says.
    """

    def __init__(
        self,
        system: System,
        start: float,
        length: float,
        state: State,
        modes: Mapping[int, int],
        stuck: Sequence[int],
        opened: Collection[int] = (),
    ) -> None:
        n = system.size
        none = np.zeros(n)
        matrix = np.zeros((2 * n + 2, 2 * n + 2))
        carrying = {j: mode for j, mode in modes.items() if j not in opened}
        constant = self._free(system, start, 0.0, carrying, stuck)
        later = self._free(system, start, length, carrying, stuck)
        matrix[:n, n : 2 * n] = np.eye(n)
        force = -np.hstack([system.stiffness, system.damping])
        for j, mode in modes.items():
            if j in system.pressed and j not in opened:
                pressed = np.concatenate([system.by_position[j], system.by_velocity[j]])
                force -= np.outer(system.incidence[j], mode * system.slipping(j, mode, 0.0) * pressed)
        force = system.mobility[:, None] * force
        matrix[n : 2 * n, : 2 * n] = force - self._taken(system, stuck, force)
        matrix[n : 2 * n, 2 * n] = constant
        matrix[n : 2 * n, 2 * n + 1] = (later - constant) / length if length > 0 else none
        matrix[2 * n + 1, 2 * n] = 1.0
        self._size, self._matrix = n, matrix
        fastest = np.abs(np.linalg.eigvals(matrix[: 2 * n, : 2 * n]).imag).max()
        self.count = int(min(MOST, max(FEWEST, 20 * length * fastest)))
        self._step = length / self.count
        one_step = exponential(matrix * self._step)
        self._states = [np.concatenate([*state, [1.0, 0.0]])]
        for _ in range(self.count):
            self._states.append(one_step @ self._states[-1])

    @staticmethod
    def _taken(system: System, stuck: Sequence[int], accelerations: Array) -> Array:
        """Return the accelerations that the forces of stuck contacts take away."""
        if not stuck:
            return np.zeros_like(accelerations)
        reaction = system.incidence[list(stuck)].T @ (system.holding(stuck) @ accelerations)
        return (system.mobility * reaction.T).T

    def _free(self, system: System, start: float, tau: float, modes: Mapping[int, int], stuck: Sequence[int]) -> Array:
        """Return the accelerations of bodies at x = 0, v = 0, drives too."""
        loads = system.loads(start, tau)
        force = loads.force + system.rest
        for j, mode in modes.items():
            force = force - system.incidence[j] * (mode * system.slipping(j, mode, 0.0) * loads.normal[j])
        a = system.mobility * force
        for i, acceleration in loads.acceleration.items():
            a[i] = acceleration
        return a - self._taken(system, stuck, a)

    def at(self, tau: float) -> State:
        """Return positions and velocities."""
        place = min(round(tau / self._step), self.count) if self._step > 0 else 0
        y = self._states[place]
        rest = tau - place * self._step
        if abs(rest) >= 1e-15 * tau > 0:
            y = self._advanced(y, rest)
        return y[: self._size], y[self._size : 2 * self._size]

    def _advanced(self, y: Array, tau: float) -> Array:
        """Return exp(M tau) y by its series, which is exact to roundoff over less than a step."""
        total, term, size = y.copy(), y, np.abs(y).max()
        for order in range(1, 60):
            term = self._matrix @ term * (tau / order)
            total += term
            if np.abs(term).max() < 1e-18 * size:
                return total
        return exponential(self._matrix * tau) @ y


class Integrated:
    """The same equations with curved loads or friction, integrated by a Runge-Kutta method of order 8."""

    def __init__(
        self,
        system: System,
        start: float,
        length: float,
        state: State,
        modes: Mapping[int, int],
        stuck: Sequence[int],
        opened: Collection[int] = (),
    ) -> None:
        self._system, self._start, n = system, start, system.size

        def rate(tau: float, y: Array) -> Array:
            balance = system.balance(start, tau, y[:n], y[n:], modes, stuck, opened)
            return np.concatenate([balance.velocity, balance.acceleration])

        longest = system.data.get("max_step", length / 20)
        step = min(length, max(length / 2000, longest))
        solver = DOP853(rate, 0.0, np.concatenate(state), length, rtol=1e-13, atol=1e-15, max_step=step)
        self._taus, self._pieces = [0.0], []
        while solver.status == "running":
            solver.step()
            if solver.status == "failed":
                raise RuntimeError(f"DOP853 fails at t = {start + solver.t:.9g} s")
            self._taus.append(solver.t)
            self._pieces.append(solver.dense_output())
        self.count = int(min(MOST, max(FEWEST, 4 * len(self._pieces))))

    def at(self, tau: float) -> State:
        """Return positions and velocities."""
        place = int(np.searchsorted(self._taus, tau)) - 1
        y = self._pieces[min(max(place, 0), len(self._pieces) - 1)](tau)
        n = self._system.size
        return y[:n], self._system.driven(y[n:], self._system.loads(self._start, tau))
