"""How fast bodies move with each other."""

import numpy as np
import pytest

from stickslip.equations.transmission import Transmission


def test_levers_hand_velocities_on_along_a_chain_and_back() -> None:
    """A motor, a screw of 1 mm/rad, a table on a spring, and a flywheel that nothing joins to them."""
    found = Transmission(4, [{0: 1e-3, 1: -1.0}, {1: 1.0, 2: -1.0}, {3: 2.0}], is_one=False)
    assert found.part.tolist() == [0, 0, 0, 1]
    assert found.ratio == pytest.approx([1.0, 1e-3, 1e-3, 1.0])
    assert found.handed_on(np.array([300.0, 0.1, 0.2, 5.0])) == pytest.approx([300.0, 0.3, 0.3, 5.0])
    # what the table has would turn the motor faster than anything turns
    assert found.handed_on(np.array([0.0, 1.0, 0.0, 5.0])) == pytest.approx([5.0, 1.0, 1.0, 5.0])
    assert not found.is_uniform


def test_drives_join_nothing() -> None:
    """Body 0 and 1 stand on the drive 2."""
    found = Transmission(2, [{0: 1.0, 2: -1.0}, {1: 1.0, 2: -1.0}], is_one=False)
    assert found.part.tolist() == [0, 1]
    assert found.handed_on(np.array([1.0, 2.0])).tolist() == [1.0, 2.0]


def test_forces_that_follow_states_join_all() -> None:
    found = Transmission(3, [{0: 1.0, 1: -1.0}], is_one=True)
    assert found.is_uniform
    assert found.handed_on(np.array([1.0, 0.0, 2.0])).tolist() == [2.0, 2.0, 2.0]


def test_in_a_loop_levers_near_1_count() -> None:
    found = Transmission(2, [{0: 1e-6, 1: -1.0}, {0: 1.0, 1: -1.0}], is_one=False)
    assert found.ratio.tolist() == [1.0, 1.0]
