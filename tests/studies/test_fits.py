"""Fits: what was put into synthetic data comes out, with errors as large as they are said to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Fit,
    Force,
    Gear,
    Scene,
    Spring,
    fit,
    piecewise_linear,
    simulate,
    step,
)

TIMES = np.linspace(0.05, 20.0, 400)
NOISE = 0.01


def pulled(static: float = 1.5, coulomb: float = 1.0, dwell: float = 1.0, stiffness: float = 2.0) -> Scene:
    """A block pulled along by a spring sticks for about as long as its dwell time."""
    return Scene(
        Body("m", inertia=1.0),
        Drive("hand", velocity=0.3),
        Spring("m", "hand", stiffness=stiffness),
        Contact("c", "m", GROUND, DryFriction(static, coulomb, dwell=dwell), normal=1.0),
    )


def measured(scene: Scene, seed: int, name: str = "m.velocity", noise: float = NOISE) -> dict[str, Any]:
    of, _, quantity = name.partition(".")
    values = getattr(simulate(scene, (0.0, TIMES[-1]), t_eval=TIMES), quantity)(of)
    return {name: (TIMES, values + noise * np.random.default_rng(seed).normal(size=TIMES.size), noise)}


TRUE = np.array([1.5, 1.0, 1.0])
NAMES = ("c.law.mu_static", "c.law.mu_coulomb", "c.law.dwell")


def normalized(found: Fit, true: np.ndarray = TRUE) -> np.ndarray:
    return (found.values - true) / found.standard_errors


@pytest.mark.slow
def test_friction_and_dwell_are_recovered_from_velocities() -> None:
    found = fit(pulled(1.6, 0.9, 0.8), NAMES, measured(pulled(), 1))
    assert np.abs(normalized(found)).max() < 3 and all(found.determined.values())
    # chi square of 400 values
    assert 2 * found.cost == pytest.approx(400, abs=90)
    assert found.standard_errors.max() < 0.05 and found.units == ("", "", "s")
    left = found.residuals()["m.velocity"]
    assert left.std() == pytest.approx(NOISE, rel=0.15)
    assert found.scene.contacts[0].law.dwell == found.values[2]
    assert "+-" in str(found) and "c.law.dwell" in str(found)


@pytest.mark.slow
def test_a_coulomb_coefficient_takes_the_static_one_along() -> None:
    """A swing that friction stops; the fit starts with mu_static = mu_coulomb, both too small."""

    def slider(mu: float, static: float, drag: float = 0.5) -> Scene:
        return Scene(
            Body("m", inertia=1.0, velocity=3.0),
            Spring("m", GROUND, stiffness=2.0, damping=drag),
            Contact("rub", "m", GROUND, DryFriction(static, mu), normal=1.0),
        )

    t = np.linspace(0.05, 6.0, 60)
    data = {"m.velocity": (t, simulate(slider(0.9, 0.9), (0.0, 6.0), t_eval=t).velocity("m"))}
    found = fit(slider(0.6, 0.6, 0.3), ["rub.law.mu_coulomb", "springs[0].damping"], data)
    assert found.values == pytest.approx([0.9, 0.5], abs=1e-7)
    law = found.scene.contacts[0].law
    assert isinstance(law, DryFriction) and law.mu_static == law.mu_coulomb
    # a static coefficient that is large enough stays
    found = fit(slider(0.6, 0.95, 0.3), ["rub.law.mu_coulomb", "springs[0].damping"], data)
    assert found.scene.contacts[0].law == DryFriction(0.95, found.values[0])


@pytest.mark.parametrize("noise", [0.005, 0.01, 0.02])
def test_the_inertia_of_a_free_body_is_that_of_the_straight_line_through_its_velocities(noise: float) -> None:
    """``v = F t / m``: the slope of the line, its error and the misfit are those of linear regression."""
    t = np.linspace(0.1, 2.0, 40)
    v = 3.0 * t / 2.0 + noise * np.random.default_rng(1).normal(size=t.size)
    scene = Scene(Body("m", inertia=1.0), Force("m", 3.0))
    found = fit(scene, ["m.inertia"], {"m.velocity": (t, v, 0.01)})
    slope = (t @ v) / (t @ t)
    assert found.values == pytest.approx([3.0 / slope], rel=1e-6)
    assert found.standard_errors == pytest.approx([3.0 / slope**2 * 0.01 / np.sqrt(t @ t)], rel=1e-4)
    chi_squared = np.sum((v - slope * t) ** 2) / 0.01**2
    assert found.misfit == pytest.approx(np.sqrt(chi_squared / 39), rel=1e-6)
    assert found.fits == (chi_squared / 39 <= 1 + 5 * np.sqrt(2 / 39)) == (noise < 0.015)


@pytest.mark.slow
def test_data_in_other_units_are_noticed() -> None:
    """Velocities in mm/s cannot be fitted by a scene in m/s: the residuals say so."""
    scene = Scene(Body("m", inertia=1.0, velocity=2.0), Damper("m", GROUND, damping=0.5))
    t = np.linspace(0.0, 2.0, 50)
    values = simulate(scene, (0.0, 2.0), t_eval=t).velocity("m")
    good = fit(scene, ["dampers[0].damping"], {"m.velocity": (t, values + 0.01 * np.cos(40 * t), 0.01)})
    assert good.fits and good.misfit < 1 and "sigma" not in str(good)
    bad = fit(scene, ["dampers[0].damping"], {"m.velocity": (t, 1000 * values, 0.01)})
    assert not bad.fits and bad.misfit > 1e3 and "look at the units" in str(bad)
    # without sigma the noise is what the fit leaves, whatever that is
    untold = fit(scene, ["dampers[0].damping"], {"m.velocity": (t, 1000 * values)})
    assert untold.fits is None and np.isnan(untold.misfit)
    size = np.sqrt(np.mean(untold.residuals()["m.velocity"] ** 2))
    assert size > 100 and f"root mean squares of the residuals: m.velocity {size:.2g};" in str(untold)


@pytest.mark.slow
def test_exact_data_give_exact_values() -> None:
    found = fit(
        pulled(1.6, 0.9, 0.8),
        NAMES,
        {"m.position": measured(pulled(), 1, "m.position", 0.0)["m.position"][:2]},
    )
    assert np.allclose(found.values, TRUE, atol=1e-9)


@pytest.mark.slow
def test_forces_are_data_too() -> None:
    data = measured(pulled(), 3, "c.force")
    found = fit(pulled(stiffness=2.2), ["springs[0].stiffness", "c.normal"], data)
    assert np.abs(normalized(found, np.array([2.0, 1.0]))).max() < 3.5


@pytest.mark.slow
def test_a_wrong_first_guess() -> None:
    bounds = {"c.law.mu_static": (0.5, 3.0), "c.law.mu_coulomb": (0.2, 2.0), "c.law.dwell": (0.1, 4.0)}
    found = fit(pulled(0.7, 0.3, 3.0), bounds, measured(pulled(), 2), starts=4)
    assert np.abs(normalized(found)).max() < 3
    assert found.starts[0][1] < 250


@pytest.mark.slow
def test_the_errors_are_as_large_as_they_are_said_to_be() -> None:
    """Of 18 normalized errors about two thirds are below 1, and next to none beyond 3."""
    off = np.array([normalized(fit(pulled(), NAMES, measured(pulled(), seed))) for seed in range(6)])
    assert (np.abs(off) > 3).sum() <= 1
    assert np.sqrt(np.mean(off**2)) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_the_error_of_a_scale_is_that_of_the_factor(scale: float) -> None:
    """v = 2 s t: linear regression for the factor s, sigma / |2 t|."""
    t, sigma = np.linspace(0.1, 1.0, 10), 0.1
    scene = Scene(Body("m", inertia=1.0), Force("m", step(0.0, 0.0, 2.0)))
    found = fit(scene, ["forces[0].signal.scale"], {"m.velocity": (t, 2 * scale * t, sigma)})
    assert found.values == pytest.approx([scale], rel=1e-9)
    assert found.standard_errors == pytest.approx([sigma / np.linalg.norm(2 * t)], rel=1e-7)


@pytest.mark.parametrize("start", [0.0, 0.3])
@pytest.mark.parametrize("unit", [1.0, 1e-9])
def test_a_value_of_0_is_known_as_well_as_any_other(start: float, unit: float) -> None:
    """Positions x0 + v t of a free body: a straight line, with the covariance of linear regression."""
    t, noise = np.linspace(0.0, 2.0, 21), 0.01 * unit
    scene = Scene(Body("m", inertia=1.0, position=start * unit, velocity=0.7 * unit))
    found = fit(scene, ["m.position", "m.velocity"], {"m.position": (t, unit * t, noise)}, atol=1e-12 * unit)
    line = np.stack([np.ones(t.size), t], axis=1)
    assert np.allclose(found.values, [0.0, unit], rtol=0, atol=1e-9 * unit)
    assert np.allclose(found.covariance, noise**2 * np.linalg.inv(line.T @ line), rtol=1e-6, atol=0)


@pytest.mark.slow
def test_what_the_data_do_not_show_is_said() -> None:
    """A block that only slips says nothing of its static friction."""
    contact = Contact("c", "m", GROUND, DryFriction(0.3, 0.2), normal=1.0)
    scene = Scene(Body("m", inertia=1.0, velocity=9.0), contact, motion="rotation")
    t = np.linspace(0.0, 2.0, 50)
    data = {"m.velocity": (t, 9.0 - 0.25 * t)}
    found = fit(scene, ["c.law.mu_coulomb", "c.law.mu_static"], data)
    assert found.values[0] == pytest.approx(0.25, abs=1e-9)
    assert found.determined == {"c.law.mu_coulomb": True, "c.law.mu_static": False}
    assert found.scene.motion == "rotation"
    assert np.isinf(found.standard_errors[1]) and "not determined" in str(found)


@dataclass(frozen=True)
class Curve:
    """A Stribeck curve below the static coefficient."""

    coulomb: float
    rest: float
    velocity: float

    def __call__(self, speed: float) -> float:
        return self.coulomb + (self.rest - self.coulomb) * float(np.exp(-((speed / self.velocity) ** 2)))


@pytest.mark.slow
def test_fields_of_a_kinetic_curve_are_parameters() -> None:
    def sliding(coulomb: float, velocity: float) -> Scene:
        law = DryFriction(0.6, 0.6, kinetic=Curve(coulomb, 0.5, velocity))
        contact = Contact("c", "m", GROUND, law, normal=1.0)
        return Scene(Body("m", inertia=1.0, velocity=1.0), contact, Damper("m", GROUND, damping=0.1))

    t = np.linspace(0.0, 1.5, 40)
    values = simulate(sliding(0.3, 0.4), (0.0, 1.5), t_eval=t, rtol=1e-11).velocity("m")
    names = ["c.law.kinetic.coulomb", "c.law.kinetic.velocity"]
    found = fit(sliding(0.25, 0.5), names, {"m.velocity": (t, values)})
    assert np.allclose(found.values, [0.3, 0.4], atol=1e-7)


def coasting(speed: float, inertia: float = 2.0, drag: float = 1.0, level: float = 0.5) -> Scene:
    """A wheel coasts: w(t) = (w0 + level/drag) exp(-drag t / inertia) - level/drag until it stands."""
    return Scene(
        Body("wheel", inertia=inertia, velocity=speed),
        Contact("brake", "wheel", GROUND, DryFriction(1.0, 1.0), normal=level),
        Damper("wheel", GROUND, damping=drag),
    )


def coasted(t: np.ndarray, speed: float) -> np.ndarray:
    return np.asarray((speed + 0.5) * np.exp(-t / 2.0) - 0.5)


@pytest.mark.slow
def test_several_records_determine_what_one_does_not() -> None:
    """A short record at one speed hardly separates drag from friction; records at two speeds do."""
    names, t = {"dampers[0].damping": (0.1, 2.0), "brake.normal": (0.1, 2.0)}, np.linspace(0.01, 0.2, 20)
    scenes = [coasting(speed, 2.0, 0.7, 0.9) for speed in (0.5, 10.0)]
    data = [{"wheel.velocity": (t, coasted(t, speed), 0.01)} for speed in (0.5, 10.0)]
    both, alone = fit(scenes, names, data, starts=1), fit(scenes[0], names, data[0], starts=1)
    assert np.allclose(both.values, [1.0, 0.5], rtol=1e-6)
    # the information of independent records adds up: inverse covariances
    other = fit(scenes[1], names, data[1], starts=1)
    together = np.linalg.inv(np.linalg.inv(alone.covariance) + np.linalg.inv(other.covariance))
    assert np.allclose(both.covariance, together, rtol=1e-4)
    assert not all(alone.determined.values()) and all(both.determined.values())
    assert [record.name for record in both.records] == ["records[0]", "records[1]"]
    assert [record.scene.bodies[0].velocity for record in both.records] == [0.5, 10.0]
    assert both.scene is both.records[0].scene and len(both.measured) == 2
    left = both.residuals()
    assert list(left) == ["records[0].wheel.velocity", "records[1].wheel.velocity"]
    assert max(np.abs(one).max() for one in left.values()) < 1e-6
    figure = both.plot()
    tops = figure.axes[::2]
    assert [f"{ax.get_title(loc='left')}.{ax.get_ylabel().partition(' ')[0]}" for ax in tops] == list(left)
    plt.close("all")


def test_a_parameter_of_one_record_is_its_own() -> None:
    """Each record has its own unknown speed at the start, and both share the drag."""
    t = np.linspace(0.1, 2.0, 20)
    names = ["records[0].wheel.velocity", "dampers[0].damping", "records[1].wheel.velocity"]
    found = fit(
        [coasting(3.0, drag=0.8), coasting(4.0, drag=0.8)],
        names,
        [{"wheel.velocity": (t, coasted(t, speed))} for speed in (2.0, 5.0)],
    )
    assert found.parameters == tuple(names)
    assert np.allclose(found.values, [2.0, 1.0, 5.0], rtol=1e-6)


def test_without_sigma_a_quantity_counts_alike_in_all_records() -> None:
    """The velocities 1 + t and 1 + 4 t of a unit mass: with equal weights the best force is 2.5, their mean."""
    t = np.linspace(0.0, 1.0, 11)
    scenes = [Scene(Body("b", inertia=1.0, velocity=1.0), Force("b", 0.0)) for _ in range(2)]
    found = fit(scenes, ["forces[0].signal"], [{"b.velocity": (t, 1.0 + k * t)} for k in (1.0, 4.0)])
    assert np.allclose(found.values, [2.5], rtol=1e-9)


@pytest.mark.slow
def test_the_residual_plot() -> None:
    found = fit(pulled(1.52), ["c.law.mu_static"], measured(pulled(), 1))
    figure = found.plot()
    top, below = figure.axes
    assert np.allclose(below.lines[0].get_ydata(), found.residuals()["m.velocity"])
    assert top.get_ylabel() == "m.velocity [m/s | rad/s]" and below.get_xlabel() == "time [s]"
    plt.close("all")


def test_bad_arguments_are_refused() -> None:
    scene, t = pulled(), np.array([0.0, 1.0, 2.0])
    good = {"m.velocity": (t, t)}

    def refused(kind: type[Exception], word: str, parameters: Any, data: Any, **options: Any) -> None:
        with pytest.raises(kind, match=word):
            fit(scene, parameters, data, **options)

    names = ["c.law.mu_static"]
    refused(ValueError, "write 'BODY.velocity'", names, {"m.speed": (t, t)})
    refused(ValueError, "write 'BODY.velocity'", names, {"x.velocity": (t, t)})
    refused(ValueError, "equally many", names, {"m.velocity": (t, t[:2])})
    refused(ValueError, "has no times; give one at least", names, {"m.velocity": ([], [])})
    refused(ValueError, "must rise", names, {"m.velocity": (t[::-1], t)})
    refused(ValueError, "finite", names, {"m.velocity": (t, t * np.nan)})
    refused(ValueError, "sigma must be positive", names, {"m.velocity": (t, t, 0.0)})
    refused(ValueError, "each of the 3 values, got 2", names, {"m.velocity": (t, t, [1.0, 2.0])})
    refused(TypeError, "sigma must be", names, {"m.velocity": (t, t, "small")})
    refused(ValueError, "for all data or for none", names, good | {"m.position": (t, t, 1.0)})
    refused(TypeError, "must be .times, values", names, {"m.velocity": t})
    refused(TypeError, "must map names", names, [])
    refused(ValueError, "must rise", {"c.law.mu_static": (2.0, 1.0)}, good)
    refused(TypeError, "must be .low, high", {"c.law.mu_static": 2.0}, good)
    refused(ValueError, "starts must be", names, good, starts=0)
    refused(ValueError, "unknown method 'foo'", names, good, method="foo")
    refused(ValueError, "atol must lie", names, good, atol=-1.0)
    refused(
        ValueError,
        "cannot determine",
        ["c.law.mu_static", "c.law.mu_coulomb"],
        {"m.velocity": (t[1:2], t[1:2])},
    )
    with pytest.raises(TypeError, match="must be a Scene"):
        fit(1, names, good)  # type: ignore[arg-type]


def test_bad_records_are_refused() -> None:
    scene, t = pulled(), np.array([0.0, 1.0, 2.0])
    good: Any = {"m.velocity": (t, t)}

    def refused(kind: type[Exception], word: str, scenes: Any, names: Any, data: Any) -> None:
        with pytest.raises(kind, match=word):
            fit(scenes, names, data)

    two, names = [scene, scene], ["c.law.mu_static"]
    refused(ValueError, "2 scenes and 1 sets of data", two, names, [good])
    refused(ValueError, "0 scenes", [], names, [])
    refused(TypeError, "must be a Scene or a sequence of them, got str", [scene, "x"], names, [good, good])
    refused(TypeError, "one for each scene", two, names, good)
    refused(ValueError, r"fit: records\[1\]: data 'x.velocity'", two, names, [good, {"x.velocity": (t, t)}])
    refused(ValueError, "for all data or for none", two, names, [good, {"m.velocity": (t, t, 1.0)}])
    refused(ValueError, "there are 2 records, counted from 0", two, ["records[2].m.velocity"], [good, good])
    refused(ValueError, r"no parameter belongs to records\[1\]", two, ["records[0].m.velocity"], [good, good])
    refused(ValueError, r"fit: records\[0\]: parameter 'x.inertia'", two, ["x.inertia"], [good, good])
    refused(ValueError, "stands twice", two, ["m.inertia", "records[0].m.inertia"], [good, good])


def test_as_many_values_as_parameters_tell_no_standard_errors() -> None:
    def wheel(level: float, drag: float) -> Scene:
        return Scene(
            Body("wheel", inertia=2.0, velocity=5.0),
            Contact("brake", "wheel", GROUND, DryFriction(1.0, 1.0), normal=level),
            Damper("wheel", GROUND, damping=drag),
        )

    t = np.array([0.6, 1.6])
    data = {"wheel.velocity": (t, simulate(wheel(0.5, 1.0), (0.0, 2.0), t_eval=t).velocity("wheel"))}
    names = ["brake.normal", "dampers[0].damping"]
    found = fit(wheel(0.4, 0.9), names, data)
    np.testing.assert_allclose(found.values, [0.5, 1.0], rtol=1e-6)
    assert np.isinf(found.standard_errors).all() and not any(found.determined.values())
    assert "2 values and as many parameters leave no standard errors" in str(found)
    with_sigma = fit(wheel(0.4, 0.9), names, {"wheel.velocity": (*data["wheel.velocity"], 0.01)})
    assert np.isfinite(with_sigma.standard_errors).all()


def test_where_no_other_values_can_be_simulated_nothing_is_fitted() -> None:
    """The bodies turn as one ratio of the gear says; all others break it."""

    def geared(ratio: float) -> Scene:
        return Scene(
            Body("a", inertia=0.2, velocity=2.0 * ratio),
            Body("b", inertia=2.0, velocity=2.0),
            Gear("g", "a", "b", ratio=ratio),
            Contact("k", "a", GROUND, DryFriction(0.3, 0.2), normal=2.0),
        )

    t = np.linspace(0.1, 5.0, 40)
    data = {"b.velocity": (t, simulate(geared(4.0), (0.0, 5.0), t_eval=t).velocity("b"))}
    for parameters in (["g.ratio"], {"g.ratio": (2.0, 8.0), "k.normal": (0.5, 5.0)}):
        with pytest.raises(ValueError, match="no values beside the starts can be simulated: gear 'g'"):
            fit(geared(3.5), parameters, data)


@pytest.mark.slow
def test_standard_errors_beside_a_parameter_that_ends_at_its_bound() -> None:
    """The damping ends at its bound 0; the errors are those of derivatives there, found by differences."""

    def swing(mu: float, k: float, x: float, v: float, c: float) -> Scene:
        return Scene(
            Body("m", inertia=1.0, position=x, velocity=v),
            Spring("m", GROUND, stiffness=k, damping=c),
            Contact("f", "m", GROUND, DryFriction(mu, mu), normal=1.0),
        )

    t = np.linspace(0.1, 12.0, 60)

    def read(values: np.ndarray) -> np.ndarray:
        return simulate(swing(*values), (0.0, 12.0), t_eval=t).position("m")

    noisy = read(np.array([0.1, 4.0, 1.0, 0.0, 0.02])) + 0.01 * np.random.default_rng(8).normal(size=60)
    names = ["f.law.mu_coulomb", "springs[0].stiffness", "m.position", "m.velocity", "springs[0].damping"]
    bounds = dict(zip(names, [(0, 1), (1, 9), (-2, 2), (-2, 2), (0, 1)], strict=True))
    found = fit(swing(0.08, 4.1, 0.95, 0.05, 0.03), bounds, {"m.position": (t, noisy, 0.01)}, starts=1)
    assert found.values[4] < 1e-6
    at, slopes = np.append(found.values[:4], 0.0), []
    for k in range(5):
        step = 1e-6 * np.eye(5)[k]
        lower = at if k == 4 else at - step
        slopes.append((read(at + step) - read(lower)) / (1e-6 if k == 4 else 2e-6))
    covariance = np.linalg.inv(np.array(slopes) @ np.array(slopes).T / 0.01**2)
    np.testing.assert_allclose(found.standard_errors, np.sqrt(np.diag(covariance)), rtol=1e-3)


@pytest.mark.slow
def test_it_says_which_values_end_at_their_bounds() -> None:
    found = fit(pulled(), {"c.law.mu_coulomb": (1.1, 1.4), "c.law.dwell": (0.5, 2.0)}, measured(pulled(), 1))
    assert found.at_bounds == ("c.law.mu_coulomb",)
    assert found.values[0] == pytest.approx(1.1, rel=1e-5)
    assert [line.endswith("(at its bound)") for line in str(found).splitlines()[:2]] == [True, False]


def test_a_flat_first_guess_of_a_load_tells_where_to_go() -> None:
    """Its points lie on one line, and a change of one of them makes three breaks of it."""

    def pushed(middle: float) -> Scene:
        load = piecewise_linear([0.5, 1.0, 2.0], [1.0, middle, 1.0])
        return Scene(Body("m", inertia=1.0, velocity=1.0), Force("m", load))

    t = np.linspace(0.05, 3.0, 60)
    data = {"m.velocity": (t, simulate(pushed(3.0), (0.0, 3.0), t_eval=t).velocity("m"))}
    found = fit(pushed(1.0), ["forces[0].signal.values[1]"], data)
    assert found.values[0] == pytest.approx(3.0, rel=1e-9)
