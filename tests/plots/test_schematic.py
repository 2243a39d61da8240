"""Schematics: everything in a scene is drawn once, inside the axes, and no text runs over another."""

from dataclasses import KW_ONLY, dataclass

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    OneWay,
    Planetary,
    PreSlip,
    Scene,
    Spring,
    StateSpace,
    Stop,
    Tie,
    output,
    plots,
    power,
    sine,
    velocity,
)
from stickslip.benchmark import flywheel_benchmark, flywheel_chain, four_flywheels
from stickslip.model.elements.base import Link, Named
from stickslip.plots.schematic import _Drawing, _link

DRY = DryFriction(0.2, 0.1)
MACHINE = Scene(
    Body("motor", inertia=0.1),
    Body("sun", inertia=0.0),
    Body("carrier", inertia=2.0),
    Body("ring", inertia=1.0),
    Body("car", inertia=1200.0),
    Body("hub", inertia=0.3),
    Drive("belt", velocity=sine(0.1, 1.0)),
    Gear("reducer", "motor", "sun", ratio=3.0),
    Planetary("planet", sun="sun", carrier="carrier", ring="ring", ratio=2.5),
    Contact("band brake", "ring", GROUND, DRY, normal=sine(10.0, 1.0)),
    OneWay("freewheel", "carrier", "hub"),
    Contact("tyre", "hub", "car", PreSlip(DRY), normal=3000.0, radius_a=0.3),
    Contact("rub", "belt", "car", DRY, normal=30.0),
    Damper("car", GROUND, damping=10.0),
    Spring("carrier", "hub", stiffness=1e4, damping=3.0),
    Force("motor", sine(1.0, 1.0)),
    Force("motor", 2.0),
    Tie("lever", {"hub": 1.0, "motor": -2.0, "ring": 0.5}),
    Gap("teeth", "sun", "carrier", lower=-0.01, upper=0.01, stiffness=1e4),
    Stop("bumper", "car", GROUND, upper=3.0),
    OneWay("sprag", "ground", "hub"),
    StateSpace("pid", A=[[0.0]], B=[[1.0]], C=[[3.0]], inputs=[velocity("car")]),
    Block("warm", inputs=[power("tyre")], states=[20.0], derivative=lambda t, x, u: u[0]),
    Force("car", output("pid")),
)
STAR = Scene(
    Body("hub", inertia=1.0),
    *(Body(f"planet {k}", inertia=0.1) for k in range(7)),
    *(Contact(f"clutch {k}", "hub", f"planet {k}", DRY, normal=10.0) for k in range(7)),
    motion="rotation",
)
SCENES = {
    "benchmark": flywheel_benchmark(),
    "four": four_flywheels(viscous=5.0),
    "machine": MACHINE,
    "star": STAR,
    "twelve": flywheel_chain(12, viscous=1.0),
    "alone": Scene(Body("a body with a name that is rather long", inertia=1.0)),
}


def texts(ax):
    return [text.get_text() for text in ax.texts]


@pytest.mark.parametrize("name", SCENES)
def test_all_is_inside_and_no_text_lies_on_another(name):
    ax = plots.schematic(SCENES[name])
    figure = ax.figure
    figure.draw(FigureCanvasAgg(figure).get_renderer())
    whole = figure.bbox
    boxes = [text.get_window_extent() for text in ax.texts]
    for box in [*boxes, *(patch.get_window_extent() for patch in ax.patches)]:
        assert whole.x0 <= box.x0 and box.x1 <= whole.x1 and whole.y0 <= box.y0 and box.y1 <= whole.y1
    for k, box in enumerate(boxes):
        for other in boxes[:k]:
            assert not (box.shrunk(0.9, 0.8)).overlaps(other.shrunk(0.9, 0.8))


def test_what_passes_behind_a_box_is_dotted_there():
    """Each clutch joins the engine to a shaft of its own: the second one passes the first shaft, and nothing else."""
    shafts = [Body(name, inertia=1.0) for name in ("engine", "first", "second", "out")]
    clutches = [Contact(f"to {end}", "engine", end, DRY, normal=10.0) for end in ("first", "second")]
    gears = Gear("g1", "first", "out", ratio=3.0), Gear("g2", "second", "out", ratio=2.0)
    ax = plots.schematic(Scene(*shafts, *clutches, *gears))
    dotted = [line for line in ax.lines if line.get_linestyle() == ":"]
    boxes = {text.get_text().partition(":")[0]: text for text in ax.texts if ":" in text.get_text()}
    (hidden,) = dotted
    (x, _), y = hidden.get_xdata(), np.mean(hidden.get_ydata())
    assert y == pytest.approx(boxes["first"].get_position()[1])
    ax.figure.draw(FigureCanvasAgg(ax.figure).get_renderer())
    name = boxes["first"].get_window_extent().transformed(ax.transData.inverted())
    assert not name.x0 <= x <= name.x1


@pytest.mark.slow
def test_letters_shrink_with_axes_of_ones_own():
    figure = Figure(figsize=(6.0, 4.0))
    left, right = figure.subplots(1, 2)
    assert plots.schematic(flywheel_chain(12), ax=right) is right
    assert MACHINE.draw(ax=left) is figure
    figure.draw(FigureCanvasAgg(figure).get_renderer())
    for ax in (left, right):
        frame = ax.get_window_extent()
        for text in ax.texts:
            box = text.get_window_extent()
            assert frame.x0 - 1 <= box.x0 and box.x1 <= frame.x1 + 1, text.get_text()


def test_names_and_values_stand_beside_what_they_belong_to():
    found = texts(plots.schematic(MACHINE))
    for text in (
        "motor: inertia 0.1",
        "belt: drive, v(t)",
        "reducer\nmotor = 3 ×\nsun",
        "planet\nratio 2.5",
        "band brake\nN(t)",
        "freewheel\ncarrier drives",
        "tyre\nN = 3000 N\nPreSlip",
        "teeth\n-0.01 to 0.01",
        "bumper\n-inf to 3",
        "sprag\nground drives",
        "F(t, state)",
        "r = 0.3",
        "k = 1e+04\nc = 3",
        "c = 10",
        "F(t), F = 2",
        "× -2",
        "carrier",
    ):
        assert text in found, text


def test_blocks_stand_below():
    found = texts(plots.schematic(MACHINE))
    assert any(text.endswith(" pid") for text in found) and any(text.endswith(" warm") for text in found)


def test_units_are_those_of_the_motion():
    assert "hub: 1 kg m²" in texts(plots.schematic(STAR))
    sliding = Scene(Body("a", inertia=2.0), Spring("a", GROUND, stiffness=3.0), Force("a", 4.0), motion="translation")
    assert set(texts(plots.schematic(sliding))) == {"a: 2 kg", "k = 3 N/m", "F = 4 N"}
    turning = Scene(*sliding.elements, motion="rotation")
    assert set(texts(plots.schematic(turning))) == {"a: 2 kg m²", "k = 3 N m/rad", "F = 4 N m"}


def test_neighbours_stand_beside_each_other():
    """A chain whose bodies are given in any order is drawn as a chain: no link passes a body."""
    chain = flywheel_chain(9)
    shuffled = Scene(*(chain.bodies[k] for k in (4, 0, 7, 2, 8, 5, 1, 3, 6)), *chain.contacts)
    drawing = _Drawing(shuffled)
    for link in drawing.links:
        first, last = drawing.span(link)
        assert first == last


def test_links_in_the_same_gap_have_columns_of_their_own():
    for scene in SCENES.values():
        drawing = _Drawing(scene)
        spans = [set(range(a, b + 1)) for a, b in map(drawing.span, drawing.links)]
        for k, one in enumerate(spans):
            for j in range(k):
                assert drawing.column[k] != drawing.column[j] or not one & spans[j]


def test_an_element_of_an_unknown_kind_is_a_labelled_link():
    @dataclass(frozen=True)
    class Magnet(Named, Link):
        name: str
        a: str
        b: str
        _: KW_ONLY
        strength: float = 1.0

    found = _link(Magnet("holder", "motor", "hub"), MACHINE)
    assert found.label == ("holder", "magnet") and list(found.ends) == ["motor", "hub"]


@pytest.mark.slow
def test_more_than_a_dozen_bodies_are_counted():
    found = texts(plots.schematic(flywheel_chain(30)))
    assert "not drawn: 18 of 30 bodies and drives, 18 of 30 elements between them" in found
    assert "w12: inertia 1" in found and "w13: inertia 1" not in found


def test_more_than_a_dozen_blocks_are_counted():
    blocks = [StateSpace(f"sum{k}", [[0.0]], [[1.0]], [[1.0]], inputs=[velocity("a")]) for k in range(13)]
    found = texts(plots.schematic(Scene(Body("a", inertia=1.0), *blocks)))
    assert "not drawn: 1 of 13 other elements" in found
    assert not any("sum12" in text for text in found)


def test_only_scenes_are_drawn():
    with pytest.raises(TypeError, match="schematic: expected a Scene, got list"):
        plots.schematic([])
