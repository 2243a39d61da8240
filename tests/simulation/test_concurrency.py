"""Simulations in threads and processes give the numbers they give alone."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from stickslip import Result, Scene, simulate
from validation.exact import REFERENCES, reference


def run(scene: Scene, stop: float) -> Result:
    return simulate(scene, (0.0, stop), t_eval=np.linspace(0.0, stop, 51))


def pools() -> list[tuple[str, partial[Executor]]]:
    spawn = multiprocessing.get_context("spawn")
    return [
        ("threads", partial(ThreadPoolExecutor, 8)),
        ("processes", partial(ProcessPoolExecutor, 2, mp_context=spawn)),
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "make"), pools())
def test_pools_change_no_bit(kind: str, make: partial[Executor]) -> None:
    cases = [reference(name) for name in REFERENCES]
    alone = [run(case.scene, case.stop) for case in cases]
    with make() as pool:
        futures = [pool.submit(run, case.scene, case.stop) for case in cases for _ in range(2)]
        found = [future.result() for future in futures]
    for k, case in enumerate(cases):
        for result in found[2 * k : 2 * k + 2]:
            assert np.array_equal(result.y, alone[k].y), (kind, case.title)
            assert result.events == alone[k].events
            for contact in case.scene.contacts:
                assert np.array_equal(result.force(contact.name), alone[k].force(contact.name))


@pytest.mark.slow
def test_one_scene_in_many_threads() -> None:
    """All threads share the compiled scene and the equations of its modes."""
    case = reference("two-blocks")
    alone = run(case.scene, case.stop)
    with ThreadPoolExecutor(8) as pool:
        for result in pool.map(lambda _: run(case.scene, case.stop), range(8)):
            assert np.array_equal(result.y, alone.y)
