"""Which parts of a scene nothing connects: drives and the ground do not, because nothing moves them."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from stickslip.elements import Contact, Damper, Element, Spring
from stickslip.scene import Scene

__all__ = ["unconnected_parts"]


def unconnected_parts(scene: Scene) -> tuple[Scene, ...]:
    """Return the parts of a scene as scenes of their own, in the order of their first bodies; none if it is one."""
    index = {body.name: i for i, body in enumerate(scene.bodies)}
    links: tuple[Contact | Spring | Damper, ...] = (*scene.contacts, *scene.springs, *scene.dampers)
    pairs = [(index[link.a], index[link.b]) for link in links if link.a in index and link.b in index]
    if len(pairs) + 1 < len(index) or pairs:
        ends = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        graph = sparse.coo_array((np.ones(len(pairs)), tuple(ends)), shape=(len(index), len(index)))
        count, part_of = connected_components(graph, directed=False)
    else:
        count, part_of = len(index), np.arange(len(index))
    if count == 1:
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
