"""Memory grows with the number of bodies, not with its square, and is given back."""

import gc
import tracemalloc
import weakref

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Scene,
    Spring,
    piecewise_linear,
    simulate,
    sine,
)
from stickslip.benchmark import flywheel_chain
from stickslip.engines.cvode import Cvode
from stickslip.engines.part_by_part.next_roots import NextRoots
from stickslip.engines.part_by_part.parts import Parts
from stickslip.engines.series import Series
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.simulation.local import Local
from stickslip.simulation.run import Run
from stickslip.simulation.simulate import compiled


@pytest.mark.slow
def test_a_long_chain_builds_no_square_array() -> None:
    # a dense matrix of 4000 by 4000 numbers alone takes 128 MB
    scene = flywheel_chain(4000)
    tracemalloc.start()
    try:
        result = simulate(scene, (0.0, 1e-6))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert result.success
    assert peak < 64e6, f"{peak / 1e6:.0f} MB"


def test_a_scene_is_freed_with_all_that_was_made_of_it() -> None:
    def simulated() -> weakref.ref[Scene]:
        scene = flywheel_chain(20)
        assert simulate(scene, (0.0, 0.01)).success
        return weakref.ref(scene)

    known = simulated()
    gc.collect()
    assert known() is None


def test_what_is_kept_of_a_motion_is_no_part_of_a_larger_array() -> None:
    # CVODE returns parts of arrays that have room for a thousand steps
    law = DryFriction(0.3, 0.2, stribeck_velocity=0.1)
    scene = Scene(Body("block", inertia=1.0, velocity=1.0), Contact("floor", "block", GROUND, law, normal=1.0))
    result = simulate(scene, (0.0, 1.0), method="BDF")
    for piece in result.trajectory.pieces:
        assert piece.path is not None
        for kept in (piece.path.taus, piece.path.last):
            assert kept.base is None or kept.base.nbytes <= 2 * kept.nbytes + 100


@pytest.mark.slow
def test_events_late_in_a_run_take_no_more_memory_than_the_first() -> None:
    def per_event(cycles: int) -> float:
        """A block is pushed loose for a second and stops, again and again; all of the motion is kept."""
        times = np.repeat(np.arange(2.0 * cycles + 1), 2)[1:-1]
        push = piecewise_linear(times, np.tile([6.0, 6.0, 0.0, 0.0], cycles))
        floor = Contact("floor", "block", GROUND, DryFriction(0.5, 0.4), normal=10.0)
        scene = Scene(Body("block", inertia=1.0), floor, Force("block", push))
        tracemalloc.start()
        try:
            result = simulate(scene, (0.0, 2.0 * cycles))
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert len(result.events) == 2 * cycles - 1
        return peak / cycles

    per_event(25)  # imports and compiles, which happens once
    assert per_event(200) < 1.2 * per_event(50)


def test_what_a_run_needs_no_more_is_freed_without_the_collector() -> None:
    """Python's collector ignores the size of arrays: those in reference cycles would stay for hundreds of events."""
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0) for i in range(30)),
        *(Spring(f"b{i}", f"b{i + 1}", stiffness=10.0) for i in range(29)),
        *(Contact(f"c{i}", f"b{i}", GROUND, DryFriction(0.5, 0.4), normal=1.0) for i in range(30)),
        Force("b0", sine(3.0, 0.5)),
    )
    system = compiled(scene)
    gc.collect()
    gc.disable()
    try:
        for method in ("auto", "BDF", "Adams"):
            assert simulate(scene, (0.0, 3.0), method=method).events
        alive = [type(x) for x in gc.get_objects()]
        of_run = {Run, Local, Parts, NextRoots, Series, Cvode, Motion} & set(alive)
        equations = weakref.ref(equations_in(np.ones(30, dtype=np.int8), system))
        system.remembered.cache_clear()
        assert equations() is None
    finally:
        gc.enable()
    assert not of_run
