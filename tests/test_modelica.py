"""The gallery of the Modelica Standard Library against what is known exactly, with the series and with CVODE."""

import importlib.util
from pathlib import Path

import pytest

from stickslip import simulate

PATH = Path(__file__).parents[1] / "examples" / "modelica" / "gallery.py"
spec = importlib.util.spec_from_file_location("gallery", PATH)
assert spec is not None
assert spec.loader is not None
gallery = importlib.util.module_from_spec(spec)
spec.loader.exec_module(gallery)


@pytest.mark.parametrize("name", gallery.CASES)
def test_the_gallery_is_exact(name: str) -> None:
    case = gallery.CASES[name]
    result = simulate(case.scene(), (0.0, case.stop))
    assert result.success
    exact = "series" in result.stats["engine"]
    assert result.energy().relative_error < (1e-12 if exact else 1e-6)
    assert max(gallery.errors(case, result), default=0.0) < (1e-11 if exact else 1e-8)
    if case.times:
        other = simulate(case.scene(), (0.0, case.stop), method="BDF")
        assert max(gallery.errors(case, other)) < 1e-6
        assert len(other.events) == len(result.events)


@pytest.mark.slow
def test_the_page_is_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gallery.main(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size < 150_000
    assert "ElastoGap: 6 events, Taylor series; 7 exact values" in capsys.readouterr().out


def test_a_gear_shifts_at_its_exact_times() -> None:
    """The load is a smooth function: tighter tolerances come as near as one likes."""
    case = gallery.CASES["SimpleGearShift"]
    result = simulate(case.scene(), (0.0, case.stop), rtol=1e-12, atol=1e-13)
    times = {event.contact: event.t for event in result.events}
    assert times["brake"] == pytest.approx(2.0408162694959744, abs=1e-11)
    assert result.sample([times["brake"]]).force("brake")[0] == pytest.approx(59.1837305040, abs=1e-8)
    assert max(gallery.errors(case, result)) < 1e-10
