"""The equilibrium of bodies on springs, reached when what is left of a motion is below the roundoff of the places."""

from __future__ import annotations

import numpy as np
import scipy

from stickslip.model.arrays import Array

# Part of its place, or of the lengths of its springs, by which a body may be away from its equilibrium: with little
# damping, roundoff of hundreds of steps keeps it moving.
_ROUNDOFF = 32 * np.finfo(float).eps


class Equilibrium:
    """Where the bodies of one set of modes come to rest on their springs.

    By ``M d'' + K d = 0``, for the distances d from the equilibrium, no body is ever farther away than
    ``|d_i| <= sqrt(2 E (K^-1)_ii)`` with ``2 E = d' M d' + r K^-1 r``, where r are the forces that do not cancel, and E
    is the energy of all bodies that springs, dampers and held rows join to this one. Dampers only take energy away.
    None of these bounds is known where K is not positive definite.
    """

    def __init__(self, inertia: Array, T: Array, by_place: Array, by_speed: Array) -> None:
        """Take the forces on the bodies by places and speeds of all, and T from the independent bodies to all."""
        self._inertia, self._T = inertia, T
        stiffness, damping = -T.T @ by_place @ T, -T.T @ by_speed @ T
        # bodies that follow two of the independent ones join these, too
        shape = T != 0
        joined = (stiffness != 0) | (damping != 0) | (shape.T @ shape)
        self._count, self._part = scipy.sparse.csgraph.connected_components(
            scipy.sparse.csr_array(joined), directed=False
        )
        # each of the bodies of a part adds its roundoff to the energy of all
        self._limit = _ROUNDOFF * np.sqrt(np.bincount(self._part, minlength=self._count))[self._part]
        # all others are at rest
        self._moving = shape.any(axis=1).nonzero()[0]
        self._part_of_moving = self._part[shape[self._moving].argmax(axis=1)] if self._moving.size else self._moving
        self._stiffness = np.diag(stiffness)
        self._compliance = _inverse(stiffness) if _takes_energy(damping) else None

    def distance(self, terms: Array, speeds: Array, accelerations: Array) -> Array | None:
        """Return how far the bodies are from the equilibrium (n,), None if that is more than roundoff of the places.

        Parameters
        ----------
        terms : array (n,)
            The sums of the sizes of all terms of the forces on each body.
        speeds, accelerations : array (n,)
            By how much the bodies are faster than at rest, and the accelerations that they would have at rest.
        """
        if self._compliance is None:
            return None
        left = self._T.T @ (self._inertia * accelerations)
        away = self._compliance @ left
        kinetic = (self._inertia * speeds**2)[self._moving]
        energy = np.zeros(self._count)
        np.add.at(energy, self._part, left * away)
        np.add.at(energy, self._part_of_moving, kinetic)
        farthest = np.sqrt(np.maximum(energy, 0.0)[self._part] * np.diag(self._compliance))
        if (farthest * self._stiffness > self._limit * (np.abs(self._T.T) @ terms)).any():
            return None
        found: Array = self._T @ away
        return found


def _inverse(stiffness: Array) -> Array | None:
    """Return the inverse of a symmetric matrix, None if it is not positive definite."""
    try:
        found: Array = scipy.linalg.cho_solve(scipy.linalg.cho_factor(stiffness), np.eye(len(stiffness)))
    except np.linalg.LinAlgError:
        return None
    return found


def _takes_energy(damping: Array) -> bool:
    """Tell whether dampers with this matrix take energy away, whatever moves."""
    strengths = np.linalg.eigvalsh(damping + damping.T)
    return bool(strengths.min(initial=0.0) >= -1e-12 * np.abs(strengths).max(initial=0.0))
