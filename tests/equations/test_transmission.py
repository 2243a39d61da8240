"""How fast bodies move with each other."""

import numpy as np
import pytest

from stickslip.equations.transmission import Transmission


def test_levers_hand_velocities_on_along_a_chain_and_back() -> None:
    """A motor, a screw of 1 mm/rad, a table on a spring, and a flywheel that nothing joins to them."""
    found = Transmission(4, [{0: 1e-3, 1: -1.0}, {1: 1.0, 2: -1.0}, {3: 2.0}])
    assert found.part.tolist() == [0, 0, 0, 1]
    assert found.ratio[:3] / found.ratio[0] == pytest.approx([1.0, 1e-3, 1e-3])
    assert found.handed_on(np.array([300.0, 0.1, 0.2, 5.0])) == pytest.approx([300.0, 0.3, 0.3, 5.0])
    # the table's 1 m/s would turn the motor at 1000 rad/s, but the bound is 5, the fastest velocity
    assert found.handed_on(np.array([0.0, 1.0, 0.0, 5.0])) == pytest.approx([5.0, 1.0, 1.0, 5.0])
    assert not found.is_uniform


def test_drives_join_nothing() -> None:
    """Body 0 and 1 stand on the drive 2."""
    found = Transmission(2, [{0: 1.0, 2: -1.0}, {1: 1.0, 2: -1.0}])
    assert found.part.tolist() == [0, 1]
    assert found.handed_on(np.array([1.0, 2.0])).tolist() == [1.0, 2.0]


def test_drives_lead_what_is_joined_to_them() -> None:
    """Drive 3 moves table 0 by a screw of 1 mm/rad; wheel 1 stands between drives 3 and 4; body 2 stands alone."""
    found = Transmission(3, [{0: 1.0, 3: -1e-3}, {1: 2.0, 3: 1.0}, {1: 1.0, 4: -1.0}, {2: 1.0}])
    assert found.led(np.array([300.0, -20.0])) == pytest.approx([0.3, 150.0, 0.0])
    assert Transmission(2, [{0: 1.0, 1: -1.0}]).led(np.array([7.0])).tolist() == [0.0, 0.0]


def test_signals_hand_velocities_on_one_way() -> None:
    """A controller of the motor reads the table behind its screw; a slide beside it follows the motor."""
    found = Transmission(4, [{0: 1e-3, 1: -1.0}], [(1, 0), (0, 2)])
    assert found.part.tolist() == [0, 0, 1, 2]
    assert found.handed_on(np.array([300.0, 0.1, 0.2, 5.0])) == pytest.approx([300.0, 0.3, 300.0, 5.0])
    assert found.handed_on(np.array([0.0, 0.0, 0.2, 5.0])).tolist() == [0.0, 0.0, 0.2, 5.0]


def test_signals_hand_on_what_signals_gave() -> None:
    found = Transmission(3, [], [(1, 2), (0, 1)])
    assert found.handed_on(np.array([3.0, 1.0, 2.0])).tolist() == [3.0, 3.0, 3.0]
    assert found.handed_on(np.array([0.0, 1.0, 2.0])).tolist() == [0.0, 1.0, 2.0]


def test_levers_of_drives_count() -> None:
    """Body 0 is a nut on a screw, drive 1."""
    assert not Transmission(1, [{0: 1.0, 1: -1e-3}]).is_uniform
    assert Transmission(1, [{0: 1.0, 1: -1.0}]).is_uniform


def test_in_a_loop_levers_near_1_count() -> None:
    found = Transmission(2, [{0: 1e-6, 1: -1.0}, {0: 1.0, 1: -1.0}])
    assert found.handed_on(np.array([1.0, 0.5])).tolist() == [1.0, 1.0]
