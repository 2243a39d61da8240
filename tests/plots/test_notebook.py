"""What notebooks show: valid HTML with a figure and the numbers of the thing shown."""

import pytest
from pages import Checked

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, signal, simulate
from stickslip.benchmark import flywheel_benchmark, flywheel_chain


@pytest.fixture(scope="module")
def wheels():
    return simulate(flywheel_benchmark(), (0.0, 1.0))


def test_a_scene_shows_its_schematic_and_its_elements():
    page = Checked(flywheel_benchmark()._repr_html_())
    text = " ".join(page.text)
    assert page.images == 1
    for word in ("wheel1 – wheel2", "interface", "normal 100", "mu_static 0.2", "brake", "inertia 10"):
        assert word in text


@pytest.mark.slow
def test_a_result_shows_figure_events_and_last_velocities(wheels):
    page = Checked(wheels._repr_html_())
    assert page.images == 1
    for word in ("the end of the time span was reached", "0.473006763", "STUCK → BACKWARD", "breakaway"):
        assert word in " ".join(page.text)
    assert f"{wheels.velocity('wheel2')[-1]:.9g}" in page.text


def test_names_are_no_markup():
    body = Body("<b>&", inertia=1.0)
    scene = Scene(body, Contact("<i>", "<b>&", GROUND, DryFriction(0.2, 0.1), normal=1.0))
    assert "<b>&" in Checked(scene._repr_html_()).text
    assert "<b>&" in Checked(simulate(scene, (0.0, 1.0))._repr_html_()).text


def test_code_and_crowds_are_shown_shortly():
    scene = Scene(Body("a", inertia=1.0), Force("a", signal(lambda t: t * t, period=1.0)))
    assert "signal a function" in " ".join(Checked(scene._repr_html_()).text)
    page = Checked(flywheel_chain(40)._repr_html_())
    assert "and 40 more" in page.text


def test_a_result_without_times_says_so():
    scene = flywheel_benchmark()
    page = Checked(simulate(scene, (0.0, 1.0), t_eval=[])._repr_html_())
    assert page.images == 0
    # the first text is the style; nothing but the message follows
    assert [text for text in page.text if text.strip()][1:] == ["the end of the time span was reached"]
