"""IDA with a sparse Jacobian: its pattern has room for all that comes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    LuGre,
    Scene,
    Spring,
    piecewise_linear,
    position,
    simulate,
)
from stickslip.engines import ida
from stickslip.engines.solvers.linear_solver import on_pattern

COUNT = 60
PULL = piecewise_linear([0.0, 1.0, 5.0], [0.0, 10.0, 1800.0])


@pytest.mark.parametrize("kind", ["curves", "springs", "bristles", "normal forces that follow positions"])
def test_a_sparse_jacobian_has_room_for_all_entries_that_come_later(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A Stribeck curve is level at rest: as a contact lets go its slope is 0, and a little later it is not."""
    curve = DryFriction(0.3, 0.2, stribeck_velocity=0.5)
    law = LuGre(DryFriction(0.3, 0.2), stiffness=1e4) if kind == "bristles" else curve
    names = [f"b{k}" for k in range(COUNT)]
    elements: list[Any] = [Force(names[-1], PULL)]
    for k, name in enumerate(names):
        below = names[k - 1] if k else GROUND
        normal: Any = 10.0 * (COUNT - k)
        if kind.startswith("normal"):
            normal = normal + 5.0 * position(names[0])
        elements += [Body(name, inertia=1.0 + 0.01 * k), Contact(f"c{k}", name, below, law, normal=normal)]
        if kind == "springs":
            elements.append(Spring(name, GROUND, stiffness=10.0))

    missing: list[int] = []

    def checked(matrix: Any, places: Any) -> Any:
        entries = scipy.sparse.coo_array(matrix)
        entries.sum_duplicates()
        rows, columns = (np.asarray(one, dtype=np.int64) for one in (entries.row, entries.col))
        missing.append(int((~np.isin(columns * entries.shape[0] + rows, places)).sum()))
        return on_pattern(matrix, places)

    monkeypatch.setattr(ida, "on_pattern", checked)
    result = simulate(Scene(*elements), (0.0, 2.0), formulation="multiplier")
    assert missing and not any(missing)
    other = simulate(Scene(*elements), (0.0, 2.0), method="BDF")
    assert [(e.contact, e.after) for e in result.events] == [(e.contact, e.after) for e in other.events]
    assert result.velocity(names[-1])[-1] == pytest.approx(other.velocity(names[-1])[-1], rel=1e-4)
