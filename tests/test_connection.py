"""Which bodies belong together: what joins them, and what does not."""

from __future__ import annotations

from stickslip import GROUND, Body, Contact, Damper, Drive, DryFriction, Force, Scene, Spring, simulate
from stickslip.connection import MOST_PARTS, unconnected_parts

LAW = DryFriction(0.3, 0.2)


def bodies(*names: str) -> list[Body]:
    return [Body(name, inertia=1.0) for name in names]


def names(scene: Scene) -> list[list[str]]:
    return [[body.name for body in part.bodies] for part in unconnected_parts(scene)]


def test_contacts_springs_and_dampers_join() -> None:
    links = (
        Contact("c", "a", "b", LAW, normal=1.0),
        Spring("b", "d", stiffness=1.0),
        Damper("e", "d", damping=1.0),
    )
    assert names(Scene(*bodies("a", "b", "d", "e"), *links)) == []
    assert names(Scene(*bodies("a", "b", "d", "e"), *links[:2])) == [["a", "b", "d"], ["e"]]


def test_drives_and_the_ground_do_not() -> None:
    scene = Scene(
        *bodies("a", "b", "d"),
        Drive("belt", velocity=1.0),
        Contact("1", "a", "belt", LAW, normal=1.0),
        Contact("2", "belt", "b", LAW, normal=1.0),
        Contact("3", "b", GROUND, LAW, normal=1.0),
        Contact("4", "d", GROUND, LAW, normal=1.0),
        Force("d", 2.0),
    )
    assert names(scene) == [["a"], ["b"], ["d"]]
    first, second, third = unconnected_parts(scene)
    assert [len(part.drives) for part in (first, second, third)] == [1, 1, 0]
    assert [[c.name for c in part.contacts] for part in (first, second, third)] == [["1"], ["2", "3"], ["4"]]
    assert [len(part.forces) for part in (first, second, third)] == [0, 0, 1]


def test_bodies_that_nothing_touches_are_parts() -> None:
    assert names(Scene(*bodies("a", "b"))) == [["a"], ["b"]]
    assert names(Scene(*bodies("a"))) == []


def test_many_parts_are_one_scene() -> None:
    few, many = ([f"b{i}" for i in range(count)] for count in (MOST_PARTS, MOST_PARTS + 1))
    assert names(Scene(*bodies(*few))) == [[name] for name in few]
    assert names(Scene(*bodies(*many))) == []


def test_a_drive_that_touches_nothing_is_in_no_part() -> None:
    scene = Scene(*bodies("a"), Drive("idle", velocity=1.0), Contact("1", "a", GROUND, LAW, normal=1.0))
    (part,) = unconnected_parts(scene)
    assert not part.drives
    assert unconnected_parts(part) == ()
    result = simulate(scene, (0.0, 1.0))
    assert result.velocity("idle").tolist() == [1.0] * result.t.size
