"""The report of a run: one file, complete, valid, and readable in a browser that is as narrow as a phone."""

import shutil
import subprocess

import numpy as np
import pytest
from pages import Checked
from PIL import Image

from stickslip import GROUND, Body, Contact, DryFriction, Scene, simulate
from stickslip.benchmark import flywheel_benchmark, flywheel_chain

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def wheels():
    return simulate(Scene(*flywheel_benchmark().elements, motion="rotation"), (0.0, 4.0))


@pytest.fixture(scope="module")
def page(wheels, tmp_path_factory):
    file = tmp_path_factory.mktemp("report") / "run.html"
    wheels.report(file, title="Two flywheels & a brake")
    return file.read_text(encoding="utf-8")


def test_everything_is_in_one_file(page):
    checked = Checked(page)
    # a link is data of the page itself, or leads within it
    assert all(link.startswith(("data:image/png;base64,", "#")) for link in checked.links)
    assert {link[1:] for link in checked.links if link.startswith("#")} <= set(checked.ids)
    assert "<script" not in page and "url(http" not in page
    assert checked.images == 3


def test_ids_of_drawings_do_not_clash(page):
    """Each drawing refers to its own markers: two of the same name would show the wrong one."""
    ids = [name for name in Checked(page).ids if name.startswith(("m", "p", "C"))]
    own = [name for name in ids if len(name) > 10]
    assert len(own) == len(set(own))


@pytest.mark.parametrize(
    "words",
    [
        "Two flywheels & a brake",
        "The end of the time span was reached: from 0 s to 4 s, 5 events.",
        "velocity at 4 s",
        "rad/s wheel2",
        "0.473006763",
        "STUCK \u2192 BACKWARD",
        "heat of interface",
        "Taylor series",
        "No event was missed: of 43 guards in the steps of the series, 34 were proved to have no root",
        "broke away backward: needed 19.9109 to stay stuck",
    ],
)
def test_it_says(page, words):
    text = " ".join(" ".join(Checked(page).text).split())
    assert words in text


def test_shares_and_energies_are_those_of_the_result(page, wheels):
    text = Checked(page).text
    for part in wheels.share("brake").values():
        assert f"{100 * part:.4g} %" in text
    assert f"{wheels.energy().contacts['brake'][-1]:.9g}" in text


@pytest.mark.slow
def test_runs_that_keep_or_hold_little_are_reported(tmp_path):
    few = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=[0.0, 0.5, 1.0], dense_output=False)
    none = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=[])
    free = simulate(Scene(Body("a", inertia=1.0)), (0.0, 1.0))
    for k, result in enumerate((few, none, free)):
        result.report(tmp_path / f"{k}.html")
        Checked((tmp_path / f"{k}.html").read_text(encoding="utf-8"))
    assert "no event to miss" in (tmp_path / "2.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_crowds_are_cut(tmp_path):
    simulate(flywheel_chain(60), (0.0, 0.6)).report(tmp_path / "r.html")
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "not drawn: 48 of 60 bodies and drives" in text
    assert len(text) < 2_000_000


@pytest.mark.slow
def test_names_are_no_markup(tmp_path):
    contact = Contact("<script>alert(1)</script>", "a", GROUND, DryFriction(0.2, 0.1), normal=1.0)
    simulate(Scene(Body("a", inertia=1.0), contact), (0.0, 1.0)).report(tmp_path / "r.html", title="<b>")
    assert "<script" not in (tmp_path / "r.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_a_browser_as_narrow_as_a_phone_shows_all_of_it(wheels, tmp_path):
    """The page is as wide as the window, its pictures are loaded, and nothing is said on the console."""
    wheels.report(tmp_path / "run.html")
    look = (
        "<script>window.onload = () => { document.title = JSON.stringify({"
        "wide: document.documentElement.scrollWidth, window: window.innerWidth,"
        "broken: [...document.images].filter(i => !(i.complete && i.naturalWidth > 0)).length,"
        "images: document.images.length + document.getElementsByTagName('svg').length}); }</script></body>"
    )
    text = (tmp_path / "run.html").read_text(encoding="utf-8")
    (tmp_path / "run.html").write_text(text.replace("</body>", look), encoding="utf-8")
    options = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--window-size=390,844",
        "--enable-logging=stderr",
    ]
    address = (tmp_path / "run.html").as_uri()
    shown = [f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", address]
    done = subprocess.run(
        [BROWSER, *options, *shown], capture_output=True, text=True, timeout=120, check=True, cwd=tmp_path
    )
    title = done.stdout.partition("<title>")[2].partition("</title>")[0]
    seen = eval(title, {"__builtins__": {}})
    assert seen["wide"] <= seen["window"]
    assert (seen["broken"], seen["images"]) == (0, 3)
    assert "CONSOLE" not in done.stderr
    shot = [f"--user-data-dir={tmp_path / 'profile'}", f"--screenshot={tmp_path / 'shot.png'}", address]
    subprocess.run([BROWSER, *options, *shot], capture_output=True, timeout=120, check=True, cwd=tmp_path)
    pixels = np.asarray(Image.open(tmp_path / "shot.png").convert("L"))
    # dark letters on a white page
    assert 0.005 < (pixels < 128).mean() < 0.5
