"""Which parts of a scene nothing connects: drives and the ground do not, because nothing moves them."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from stickslip.elements import Contact, Damper, Element, Spring
from stickslip.scene import Scene

__all__ = ["MOST_PARTS", "unconnected_parts"]

MOST_PARTS = 8
"""Scenes of more parts are integrated as one."""


def unconnected_parts(scene: Scene) -> tuple[Scene, ...]:
    """Return the parts of a scene as scenes of their own, in the order of their first bodies.

    A drive that touches nothing is in none of them. None if the scene is one part, or if they are many: their points
    are no fewer in all, and each is one of the whole.
    """
    index = {body.name: i for i, body in enumerate(scene.bodies)}
    links: tuple[Contact | Spring | Damper, ...] = (*scene.contacts, *scene.springs, *scene.dampers)
    pairs = [(index[link.a], index[link.b]) for link in links if link.a in index and link.b in index]
    ends = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    graph = sparse.coo_array((np.ones(len(pairs)), tuple(ends)), shape=(len(index), len(index)))
    count, part_of = connected_components(graph, directed=False)
    touched = {end for link in links for end in (link.a, link.b)}
    if count > MOST_PARTS or (count == 1 and all(drive.name in touched for drive in scene.drives)):
        return ()
    elements: list[list[Element]] = [[] for _ in range(count)]
    drives: list[set[str]] = [set() for _ in range(count)]
    for body, part in zip(scene.bodies, part_of.tolist(), strict=True):
        elements[part].append(body)
    for link in links:
        part = int(part_of[index[link.a if link.a in index else link.b]])
        elements[part].append(link)
        drives[part] |= {link.a, link.b}
    for force in scene.forces:
        elements[int(part_of[index[force.body]])].append(force)
    for drive in scene.drives:
        for part in range(count):
            if drive.name in drives[part]:
                elements[part].append(drive)
    return tuple(Scene(*part) for part in elements)
