"""BLAS uses one thread while a simulation runs, and as many as before when it ends."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, SimulationError, signal, simulate
from stickslip.equations.one_thread import one_thread
from stickslip.simulation.simulate import compiled

LIBRARIES = ThreadpoolController().select(user_api="blas")
MANY = 2

SYSTEM = compiled(Scene(Body("wheel", inertia=1.0)))

needs_blas = pytest.mark.skipif(not LIBRARIES.lib_controllers, reason="no BLAS that has threads is loaded")


def threads() -> set[int]:
    return {library.num_threads for library in LIBRARIES.lib_controllers}


def pushed(seen: list[set[int]], calls: float) -> Scene:
    """Return a slider whose load notes how many threads there are, and fails after `calls` calls."""

    def load(t: float) -> float:
        seen.append(threads())
        if len(seen) > calls:
            raise ArithmeticError("the load failed")
        return float(5 + np.sin(t))

    return Scene(
        Body("slider", inertia=1.0),
        Contact("floor", "slider", GROUND, DryFriction(0.2, 0.1), normal=10.0),
        Force("slider", signal(load)),
    )


@needs_blas
def test_a_run_has_one_thread() -> None:
    with LIBRARIES.limit(limits=MANY):
        simulate(pushed(seen := [], np.inf), (0.0, 1.0))
        assert seen[-1] == {1}
        assert threads() == {MANY}


@needs_blas
def test_a_run_that_fails_restores_the_threads() -> None:
    with LIBRARIES.limit(limits=MANY):
        with pytest.raises(SimulationError, match="the load failed"):
            simulate(pushed(seen := [], 100), (0.0, 1.0))
        assert seen[-1] == {1}
        assert threads() == {MANY}


@needs_blas
def test_the_last_one_out_restores_the_threads() -> None:
    with LIBRARIES.limit(limits=MANY):
        first, second = one_thread(SYSTEM, always=True), one_thread(SYSTEM, always=True)
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert threads() == {1}
        second.__exit__(None, None, None)
        assert threads() == {MANY}


@needs_blas
def test_a_small_scene_leaves_the_threads_alone() -> None:
    with LIBRARIES.limit(limits=MANY), one_thread(SYSTEM):
        assert threads() == {MANY}
