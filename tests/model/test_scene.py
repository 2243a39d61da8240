"""Scenes: frozen data, variants, plain data."""

import json
import pickle
import tomllib
from dataclasses import FrozenInstanceError
from itertools import permutations

import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Karnopp,
    LuGre,
    PreSlip,
    Scene,
    Spring,
    piecewise_linear,
    signal,
    sine,
    step,
    triangle,
)
from stickslip.model.signals import Constant

DRY = DryFriction(mu_static=0.2, mu_coulomb=0.1, dwell=0.1)
BRAKE = triangle(0.05, 0.10, 0.15, slope=3000) + triangle(0.4, 0.5, 0.6, slope=3000)
WHEELS = Scene(
    Body("wheel1", inertia=1.0, velocity=1.0),
    Body("wheel2", inertia=10.0, velocity=1.01),
    Contact("interface", "wheel1", "wheel2", DRY, normal=100.0),
    Contact("brake", "wheel1", GROUND, DRY, normal=BRAKE),
)
EVERYTHING = Scene(
    Body("block", inertia=2.0, velocity=-1.0, position=0.5),
    Body("mass", inertia=1e-3),
    Drive("belt", velocity=sine(1.0, 2.0), position=0.25),
    Drive("plate", velocity=piecewise_linear([0, 1], [0, 1])),
    Contact("rub", "block", "belt", PreSlip(DRY, shape="tanh"), normal=sine(1, 1) + step(0.5), rested=3.0),
    Contact("slide", "mass", "plate", LuGre(DRY, stiffness=1e4), normal=3),
    Spring("block", "mass", stiffness=100.0, damping=0.5, rest=-0.1),
    Spring("mass", GROUND, stiffness=10.0),
    Damper("block", GROUND, damping=2.0),
    Force("mass", step(1.0)),
    Force("block", 4),
)


def test_a_scene_sorts_its_elements_by_kind_and_keeps_their_order() -> None:
    assert [b.name for b in EVERYTHING.bodies] == ["block", "mass"]
    assert [d.name for d in EVERYTHING.drives] == ["belt", "plate"]
    assert [c.name for c in EVERYTHING.contacts] == ["rub", "slide"]
    assert [s.b for s in EVERYTHING.springs] == ["mass", GROUND]
    assert len(EVERYTHING.elements) == 11


def test_elements_may_stand_in_any_order() -> None:
    body, contact, force = WHEELS.bodies[0], WHEELS.contacts[1], Force("wheel1", 1.0)
    scenes = {Scene(*order) for order in permutations((body, contact, force))}
    assert len(scenes) == 1


def test_numbers_become_floats_and_loads_signals() -> None:
    body = Body("a", inertia=2, velocity=1)
    assert type(body.inertia) is float
    assert Contact("c", "a", GROUND, DRY, normal=5).normal == Constant(5.0)
    assert Force("a", 2).signal == Constant(2.0)
    assert Drive("d", velocity=1).velocity == Constant(1.0)


def test_a_scene_is_frozen_and_compares_by_value() -> None:
    with pytest.raises(FrozenInstanceError):
        WHEELS.bodies = ()  # type: ignore[misc]
    assert Scene(*WHEELS.elements) == WHEELS
    assert hash(Scene(*WHEELS.elements)) == hash(WHEELS)
    assert WHEELS != EVERYTHING


def test_a_scene_prints_the_call_that_makes_it() -> None:
    text = repr(WHEELS)
    assert text.startswith("Scene(Body(name='wheel1', inertia=1.0, velocity=1.0, position=0.0, motion=None), ")
    assert "Contact(name='brake', a='wheel1', b='ground'" in text


def test_a_contact_may_be_called_like_a_body_or_the_ground() -> None:
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("ground", "a", GROUND, DRY, normal=1.0),
        Contact("a", GROUND, "a", DRY, normal=1.0),
    )
    assert [c.name for c in scene.contacts] == ["ground", "a"]


# variants


def test_replace_changes_one_element() -> None:
    heavy = WHEELS.replace("wheel2", inertia=20.0)
    assert [b.inertia for b in heavy.bodies] == [1.0, 20.0]
    assert heavy.contacts == WHEELS.contacts
    assert WHEELS.bodies[1].inertia == 10.0
    free = WHEELS.replace("brake", normal=0)
    assert free.contacts[1].normal == Constant(0.0)
    assert EVERYTHING.replace("belt", velocity=3).drives[0].velocity == Constant(3.0)


def test_what_has_no_name_is_replaced_by_its_number() -> None:
    same = Force("m", 1.0)
    scene = Scene(Body("m", inertia=1.0), same, same, Spring("m", GROUND, stiffness=2.0))
    assert scene.replace("forces[1]", signal=3.0).forces == (same, Force("m", 3.0))
    assert scene.replace("springs[0]", stiffness=5.0).springs[0].stiffness == 5.0
    with pytest.raises(ValueError, match=r"is called 'springs\[1\]'; known are 'm'; springs, dampers"):
        scene.replace("springs[1]", stiffness=5.0)
    with pytest.raises(ValueError, match=r"force on 'm': unknown field 'torque'; a Force has body, signal"):
        scene.replace("forces[0]", torque=5.0)


def test_replace_checks_what_it_makes() -> None:
    with pytest.raises(ValueError, match=r"body 'wheel1': inertia must be positive, got -1"):
        WHEELS.replace("wheel1", inertia=-1)
    with pytest.raises(ValueError, match=r"no body is called 'wheel9'"):
        WHEELS.replace("brake", a="wheel9")


def test_laws_can_be_changed_throughout() -> None:
    smooth = WHEELS.regularized(velocity=1e-2, shape="arctan")
    assert [c.law for c in smooth.contacts] == [PreSlip(DRY, 1e-2, "arctan")] * 2
    assert smooth.regularized() == WHEELS.regularized()
    banded = WHEELS.with_laws(lambda law: Karnopp(law.core))
    assert all(isinstance(c.law, Karnopp) for c in banded.contacts)
    assert EVERYTHING.regularized().contacts[1].law == PreSlip(DRY)


# data


@pytest.mark.parametrize("scene", [WHEELS, EVERYTHING])
def test_plain_data_and_back(scene: Scene) -> None:
    data = scene.to_dict()
    assert Scene.from_dict(data) == scene
    assert Scene.from_dict(json.loads(json.dumps(data))) == scene
    assert pickle.loads(pickle.dumps(scene)) == scene


def test_plain_data_leave_out_defaults_and_empty_tables() -> None:
    scene = Scene(Body("a", inertia=1), Contact("c", "a", GROUND, DryFriction(0.2, 0.1), normal=3.0))
    assert scene.to_dict() == {
        "bodies": [{"name": "a", "inertia": 1.0}],
        "contacts": [
            {
                "name": "c",
                "a": "a",
                "b": "ground",
                "law": {"type": "DryFriction", "mu_static": 0.2, "mu_coulomb": 0.1},
                "normal": 3.0,
            }
        ],
    }


def test_a_scene_file() -> None:
    text = """
    [[bodies]]
    name = "block"
    inertia = 2
    [[contacts]]
    name = "floor"
    a = "block"
    b = "ground"
    normal = 10
    law = {mu_static = 0.4, mu_coulomb = 0.3}
    [[forces]]
    body = "block"
    signal = {type = "sum", terms = [1, {type = "sine", amplitude = 2.0, frequency = 1.0}]}
    """
    assert Scene.from_dict(tomllib.loads(text)) == Scene(
        Body("block", inertia=2.0),
        Contact("floor", "block", GROUND, DryFriction(0.4, 0.3), normal=10.0),
        Force("block", 1.0 + sine(2.0, 1.0)),
    )


def test_what_is_code_says_which_element_holds_it() -> None:
    scene = Scene(Body("a", inertia=1.0), Force("a", signal(abs)))
    with pytest.raises(ValueError, match=r"force on 'a': signal function abs is code, not data"):
        scene.to_dict()
    law = DryFriction(0.2, 0.1, kinetic=lambda v: 0.1)
    scene = Scene(Body("a", inertia=1.0), Contact("c", "a", GROUND, law, normal=1.0))
    with pytest.raises(ValueError, match=r"contact 'c': DryFriction.kinetic is code"):
        scene.to_dict()


class CountedName(str):
    """A name that counts how often names are looked up or compared."""

    looks = 0

    def __hash__(self) -> int:
        CountedName.looks += 1
        return super().__hash__()

    def __eq__(self, other: object) -> bool:
        CountedName.looks += 1
        return super().__eq__(other)


def test_the_work_to_make_a_scene_grows_with_its_size_not_with_the_square() -> None:
    looks = []
    for count in (500, 2000):
        names = [CountedName(f"b{i}") for i in range(count)]
        bodies = [Body(name, inertia=1.0) for name in names]
        contacts = [Contact(CountedName(f"c{i}"), names[i], names[i + 1], DRY, normal=10.0) for i in range(count - 1)]
        CountedName.looks = 0
        scene = Scene(*bodies, *contacts)
        looks.append(CountedName.looks)
        assert len(scene.elements) == 2 * count - 1
    assert 0 < looks[1] < 4.5 * looks[0], looks


def test_the_motion_is_kept_by_variants_and_plain_data() -> None:
    turning = Scene(*WHEELS.elements, motion="rotation")
    assert turning.motion == "rotation" and WHEELS.motion is None
    assert turning != WHEELS
    assert Scene.from_dict(turning.to_dict()) == turning == pickle.loads(pickle.dumps(turning))
    assert "motion" not in WHEELS.to_dict()
    for variant in (turning.replace("brake", normal=1.0), turning.regularized()):
        assert variant.motion == "rotation"
    assert repr(turning).endswith(", motion='rotation')")
    for wrong in ("spin", 3, ["rotation"]):
        with pytest.raises(ValueError, match="motion must be 'rotation' or 'translation', got"):
            Scene(*WHEELS.elements, motion=wrong)  # type: ignore[arg-type]
