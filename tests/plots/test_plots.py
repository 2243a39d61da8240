"""Drawings: what stands on the axes is what the result says."""

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    Karnopp,
    LuGre,
    Mode,
    PreSlip,
    Sampled,
    Scene,
    SimulationError,
    Spring,
    StateSpace,
    feedback,
    output,
    plots,
    simulate,
    sine,
    step,
    velocity,
)
from stickslip.benchmark import flywheel_benchmark, flywheel_chain
from stickslip.plots.style import value_raster
from stickslip.results.energy import energy
from validation.exact import reference

VELOCITY = "velocity [m/s | rad/s]"
FORCE = "force [N | N m]"


@pytest.fixture(scope="module")
def wheels():
    return simulate(flywheel_benchmark(), (0.0, 4.0))


@pytest.fixture(scope="module")
def blocks():
    return simulate(reference("two-blocks").scene, (0.0, 40.0))


@pytest.fixture(scope="module")
def chain():
    return simulate(flywheel_chain(30), (0.0, 1.0))


def labels(ax):
    legend = ax.get_legend()
    return [text.get_text() for text in legend.get_texts()] if legend else []


def curve(ax, label):
    (line,) = [line for line in ax.get_lines() if line.get_label() == label]
    return line


def drawn(ax):
    ax.get_figure().draw_without_rendering()


def raster(ax):
    return np.asarray(ax.collections[0].get_array())


def test_overview_of_the_benchmark(wheels):
    figure = plots.overview(wheels)
    assert isinstance(figure, Figure)
    velocity, mode, interface, brake, normal = figure.axes
    assert [ax.get_ylabel() for ax in figure.axes] == [VELOCITY, "mode", FORCE, FORCE, "normal force [N]"]
    assert [ax.get_xlabel() for ax in figure.axes] == ["", "", "", "", "time [s]"]
    assert all(ax.get_shared_x_axes().joined(ax, velocity) for ax in figure.axes)
    assert [text.get_text() for text in mode.get_yticklabels()] == ["interface", "brake"]
    assert curve(normal, "brake").get_ydata().max() == pytest.approx(300.0)
    assert interface.get_legend().get_title().get_text() == "contact interface"
    assert brake.get_ylim()[1] >= 30.0
    low, high = velocity.get_xlim()
    assert low <= 0.0 and high >= 4.0
    figure.draw_without_rendering()


@pytest.mark.slow
def test_legends_stand_beside_the_data(wheels):
    figure = plots.overview(wheels)
    figure.draw_without_rendering()
    for ax in figure.axes:
        frame, legend = ax.get_window_extent(), ax.get_legend().get_window_extent()
        assert legend.x0 >= frame.x1 - 1
        assert legend.x1 <= figure.bbox.x1 + 1


def test_overview_takes_a_choice_a_span_and_axes(wheels):
    axes = Figure().subplots(3, 1)
    figure = plots.overview(wheels, contacts=["interface"], bodies=["wheel2"], t_span=(0.4, 0.7), axes=axes)
    assert figure is axes[0].get_figure()
    assert "wheel1" not in labels(axes[0])
    assert axes[2].get_xlim() == (0.4, 0.7)
    with pytest.raises(ValueError, match="5 panels need as many axes, got 3"):
        plots.overview(wheels, axes=axes)


def test_overview_without_contacts_is_velocities_alone():
    result = simulate(Scene(Body("a", inertia=1.0, velocity=1.0)), (0.0, 1.0))
    assert len(plots.overview(result).axes) == 1


def test_result_plot_is_the_overview(wheels):
    assert len(wheels.plot(contacts=["brake"]).axes) == 4


def test_legends_do_not_call_requested_times_fit_for_a_plot():
    t_eval = [0.0, 0.2, 1.0]
    kept = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=t_eval, dense_output=False)
    assert labels(plots.velocities(kept))[-1] == "times that were kept"
    assert labels(plots.characteristic(kept, "brake"))[-1] == "times that were kept"


def test_velocities_follow_the_motion_between_computed_points(wheels):
    ax = plots.velocities(wheels)
    assert ax.get_xlabel() == "time [s]"
    assert labels(ax) == ["wheel1", "wheel2", "held by a contact", "times fit for a plot"]
    one, two = curve(ax, "wheel1"), curve(ax, "wheel2")
    assert one.get_linestyle() != two.get_linestyle()
    t, v = one.get_data()
    assert np.array_equal(v, wheels.fit_for_plot(1500).velocity("wheel1"))
    assert np.abs(v - wheels(t)[0]).max() < 1e-12
    dots = [line for line in ax.get_lines() if line.get_linestyle() == "None" and line.get_xdata().size]
    assert [line.get_xdata().size for line in dots] == [wheels.t.size] * 2
    assert dots[0].get_marker() != dots[1].get_marker()
    drawn(ax)


def test_broad_lines_run_where_a_contact_holds(wheels):
    ax = plots.velocities(wheels, ["wheel1"])
    broad = [line for line in ax.get_lines() if line.get_linewidth() > 5 and line.get_xdata().size]
    assert len(broad) == 2  # the interface holds it, then the brake
    for line, name in zip(broad, ("interface", "brake"), strict=True):
        t, v = line.get_data()
        assert np.array_equal(np.isfinite(v), wheels.fit_for_plot(1500).mode(name) == 0)
        assert t.min() == 0.0


@pytest.mark.parametrize("name", ["wheel1", "wheel2"])
def test_broad_lines_run_under_both_bodies_that_a_contact_holds(wheels, name):
    ax = plots.velocities(wheels, [name])
    assert [line for line in ax.get_lines() if line.get_linewidth() > 5 and line.get_xdata().size]


def test_broad_lines_end_where_the_contact_lets_go(wheels):
    ax = plots.velocities(wheels, ["wheel1"])
    ax.set_xlim(0.5, 0.7)
    figure = ax.get_figure()
    figure.set_dpi(200)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., 0]
    brake = [event.t for event in wheels.events if event.contact == "brake"]
    for inside in (False, True):
        for t, side in zip(brake, (-1, 1), strict=True):
            x, y = ax.transData.transform((t, 0.0))
            # just below the curve, four pixels off the end of the line that is eight points wide
            column = round(x) + (-4 if inside else 4) * side
            assert (pixels[-round(y - 8), column] == round(0.82 * 255)) == inside


def test_no_broad_line_where_nothing_presses():
    law = DryFriction(0.2, 0.1)
    scene = Scene(Body("a", inertia=1.0), Contact("c", "a", GROUND, law, normal=step(0.5, 0.0, 1.0)))
    ax = plots.velocities(simulate(scene, (0.0, 1.0)))
    (broad,) = (line for line in ax.get_lines() if line.get_linewidth() > 5 and line.get_xdata().size)
    t, v = broad.get_data()
    assert t[np.isfinite(v)].min() == 0.5


def test_many_points_become_ticks_and_drives_have_none(blocks):
    ax = plots.velocities(blocks)
    assert labels(ax)[:3] == ["b0", "b1", "plate"]
    every = math.ceil(blocks.t.size / 200)
    ticks = curve(ax, f"times fit for a plot, 1 in {every}")
    assert ticks.get_marker() == "|"
    assert np.array_equal(ticks.get_xdata(), blocks.t[::every])
    drawn(ax)


def test_unknown_names_are_refused(wheels):
    with pytest.raises(ValueError, match="no body is called 'wheel3'"):
        plots.velocities(wheels, ["wheel3"])
    with pytest.raises(ValueError, match="no contact is called 'clutch'"):
        plots.contact_forces(wheels, "clutch")


def test_the_ground_is_drawn_at_rest(wheels):
    ground = curve(wheels.plot(bodies=[GROUND], contacts=[]).axes[0], GROUND)
    assert not np.any(ground.get_ydata())


def test_no_contacts_make_an_empty_raster():
    alone = simulate(Scene(Body("b", inertia=1.0, velocity=1.0)), (0.0, 1.0))
    assert not plots.load_of_contacts(alone).get_yticklabels()


def test_a_gap_has_no_row_among_loads_of_contacts() -> None:
    body = Body("m", inertia=1.0, velocity=1.0)
    gap = Gap("play", "m", GROUND, upper=1.0, stiffness=10.0)
    both = simulate(Scene(body, Contact("c", "m", GROUND, DryFriction(0.3, 0.2), normal=1.0), gap), (0.0, 1.0))
    assert [label.get_text() for label in plots.load_of_contacts(both).get_yticklabels()] == ["c"]
    named = plots.load_of_contacts(both, ["c", "play"])
    assert [label.get_text() for label in named.get_yticklabels()] == ["c", "play"]


def test_many_bodies_become_a_raster(chain):
    ax = plots.velocities(chain)
    values = raster(ax).reshape(30, -1)
    assert values[:, 0] == pytest.approx([body.velocity for body in chain.scene.bodies])
    assert values[:, -1] == pytest.approx(chain.y[:, -1])
    (bar,) = ax.child_axes
    assert bar.get_ylabel() == VELOCITY
    assert ax.get_yticklabels()[0].get_text() == "w1"
    assert ax.yaxis_inverted()
    drawn(ax)


def test_overview_of_many_gaps_says_how_many_are_not_drawn():
    bodies = [Body(f"car {i}", inertia=1.0, velocity=1.0 - 0.1 * i, position=float(i)) for i in range(7)]
    couplers = [Gap(f"c{i}", f"car {i + 1}", f"car {i}", lower=0.5, upper=1.5, stiffness=50.0) for i in range(6)]
    figure = simulate(Scene(*bodies, *couplers), (0.0, 1.0)).plot()
    notes = [text.get_text() for ax in figure.axes for text in ax.texts]
    assert notes == ["not drawn:\n2 more gaps and stops"]
    assert [ax.get_ylabel() for ax in figure.axes].count("stretch [m | rad]") == 4
    drawn(figure.axes[0])


@pytest.mark.slow
def test_overview_of_many_bodies(chain):
    figure = plots.overview(chain)
    main = figure.axes
    assert [ax.get_ylabel() for ax in main] == ["body", "mode", "contact", "normal force [N]"]
    modes = raster(main[1])
    assert set(np.unique(modes)) <= {-1, 0, 1}
    load_of = raster(main[2])
    assert np.nanmin(load_of) >= 0 and np.nanmax(load_of) == pytest.approx(1.0)
    figure.draw_without_rendering()
    for ax in main[:3]:  # the legend of the last panel is as wide as it likes
        (bar,) = ax.child_axes
        assert 0 < bar.get_window_extent().x0 - ax.get_window_extent().x1 < 0.03 * figure.bbox.width
        assert bar.get_tightbbox().x1 <= figure.bbox.x1 + 1


def test_mode_strips_are_the_modes(wheels):
    ax = plots.modes(wheels)
    assert labels(ax) == ["FORWARD", "STUCK", "BACKWARD", "thin: normal force 0"]
    bars = {0: [], 1: []}
    for alike in ax.collections:
        for box in (path.get_extents() for path in alike.get_paths()):
            bars[round(0.5 * (box.y0 + box.y1))].append((box.x0, box.x1, box.height > 0.5, alike.get_hatch()))
    bars = {place: sorted(found, key=lambda bar: bar[0]) for place, found in bars.items()}
    times = [event.t for event in wheels.events if event.contact == "interface"]
    assert [bar[0] for bar in bars[0]] == pytest.approx([0.0, *times])
    assert [bar[3] for bar in bars[0]] == ["....", None, "....", None]
    assert [bar[2] for bar in bars[1]] == [False, True, False, True, True, True, False]
    assert bars[1][-1][:2] == pytest.approx((0.6, 4.0))
    drawn(ax)


def test_the_legend_names_only_modes_that_occur():
    floor = Contact("c", "a", GROUND, DryFriction(0.2, 0.1), normal=1.0)
    ax = plots.modes(simulate(Scene(Body("a", inertia=1.0, velocity=0.05), floor), (0.0, 1.0)))
    assert labels(ax) == ["FORWARD", "STUCK"]


def test_force_lies_within_its_level(wheels):
    ax = plots.contact_forces(wheels, "interface")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", FORCE)
    assert labels(ax) == ["± breakaway level", "force r"]
    force, level = curve(ax, "force r").get_ydata(), curve(ax, "± breakaway level").get_ydata()
    assert np.all(np.abs(force) <= level * (1 + 1e-9))
    assert force.min() == pytest.approx(-19.91, abs=0.01)
    drawn(ax)


def anisotropic(**options):
    """A body on ground that holds 5 N forward (0.5 10 N) and 1 N backward (0.1 10 N), pushed to and fro."""
    dry = DryFriction(0.5, 0.4, mu_static_backward=0.1, mu_coulomb_backward=0.05, **options)
    scene = Scene(Body("m", inertia=1.0), Contact("c", "m", GROUND, dry, normal=10.0), Force("m", sine(6.0, 1.0)))
    return simulate(scene, (0.0, 2.0))


def test_both_levels_of_an_anisotropic_contact_are_drawn_as_they_are():
    result = anisotropic()
    ax = plots.contact_forces(result, "c")
    assert labels(ax) == ["breakaway levels", "force r"]
    upper, lower = ax.get_lines()[:2]
    assert set(upper.get_ydata()) == {5.0} and set(lower.get_ydata()) == {-1.0}
    force = curve(ax, "force r").get_ydata()
    assert force.max() == pytest.approx(5.0, rel=1e-6) and force.min() == pytest.approx(-1.0, rel=1e-6)
    low, high = ax.collections[0].get_paths()[0].get_extents().intervaly
    assert (low, high) == (-1.0, 5.0)
    drawn(ax)


def test_breakaway_says_which_side_it_returns():
    result = anisotropic()
    assert set(result.breakaway("c", 1)) == {5.0} and set(result.breakaway("c", -1)) == {1.0}
    assert set(result.breakaway("c", Mode.BACKWARD)) == {1.0}
    # by default the side of the force
    force, level = result.force("c"), result.breakaway("c")
    assert np.array_equal(level, np.where(force < 0, 1.0, 5.0))
    assert np.all(np.abs(force) <= level * (1 + 1e-9))
    for wrong in (0, 2, "forward"):
        with pytest.raises(ValueError, match=r"breakaway of contact 'c': direction must be \+1"):
            result.breakaway("c", wrong)


def test_both_levels_rise_with_the_dwell_time():
    # from mu_c N where it becomes stuck, by the factor 1 - exp(-age / tau): here from the start of the motion
    dry = DryFriction(0.5, 0.4, mu_static_backward=0.1, mu_coulomb_backward=0.05, dwell=0.2)
    scene = Scene(Body("m", inertia=1.0), Contact("c", "m", GROUND, dry, normal=10.0))
    result = simulate(scene, (0.0, 1.0), t_eval=np.linspace(0.0, 1.0, 11))
    lag = np.exp(-result.t / 0.2)
    np.testing.assert_allclose(result.breakaway("c", 1), 5.0 - 1.0 * lag, rtol=1e-14)
    np.testing.assert_allclose(result.breakaway("c", -1), 1.0 - 0.5 * lag, rtol=1e-14)


def test_normal_forces_of_many_contacts_become_a_raster():
    normal, law = sine(1.0, 1.0, offset=2.0), DryFriction(0.2, 0.1)
    pads = [Contact(f"p{i}", "a", GROUND, law, normal=normal) for i in range(14)]
    result = simulate(Scene(Body("a", inertia=1.0, velocity=1.0), *pads), (0.0, 0.1))
    ax = plots.normal_forces(result)
    assert raster(ax).reshape(14, -1)[:, 0] == pytest.approx(np.full(14, 2.0))
    assert [line.get_label() for line in plots.normal_forces(result, ["p3"]).get_lines()] == ["p3"]


def test_normal_forces_that_do_not_vary_are_drawn_where_no_others_are(blocks):
    labels = [line.get_label() for line in plots.normal_forces(blocks).get_lines()]
    assert labels == ["f0", "f1"]
    # without a contact there is no legend, either: warnings are errors here
    free = simulate(Scene(Body("a", inertia=1.0, velocity=1.0)), (0.0, 1.0))
    assert not plots.normal_forces(free).get_lines()


def test_phase_portrait(blocks):
    ax = plots.phase_portrait(blocks, "f0")
    assert ax.get_xlabel() == "relative displacement [m | rad]"
    assert ax.get_ylabel() == f"relative {VELOCITY}"
    assert labels(ax) == ["trajectory", "stuck", "start", "end"]
    x, w = curve(ax, "trajectory").get_data()
    assert x[0] == 0.05 and x[-1] == blocks.position("b0")[-1]
    assert w.max() == pytest.approx(blocks.velocity("b0").max(), rel=1e-3)
    assert np.all(curve(ax, "stuck").get_ydata() == 0.0)
    drawn(ax)


def test_phase_portrait_of_a_body_on_a_belt_closes():
    """It sticks from 0.125 m to 2.5 N / k; while it slips, it is on a circle about 1.5 N / k in x and v / 2."""
    scene = Scene(
        Body("block", inertia=1.0),
        Drive("belt", velocity=0.1),
        Spring("block", GROUND, stiffness=4.0),
        Contact("rub", "block", "belt", DryFriction(0.5, 0.3), normal=5.0),
    )
    result = simulate(scene, (0.0, 40.0))
    ax = plots.phase_portrait(result, "rub", body="block")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("position of block [m | rad]", "velocity of block [m/s | rad/s]")
    x, v = curve(ax, "trajectory").get_data()
    radius = math.hypot(2.5 / 4.0 - 1.5 / 4.0, 0.1 / 2.0)
    assert x.max() == pytest.approx(1.5 / 4.0 + radius, rel=1e-3)
    assert (v.max(), v.min()) == pytest.approx((0.1, -2.0 * radius), rel=1e-3)
    assert np.all(curve(ax, "stuck").get_ydata() == pytest.approx(0.1))
    with pytest.raises(ValueError, match="no body is called 'blok'"):
        plots.phase_portrait(result, "rub", body="blok")
    drawn(ax)


def test_characteristic_lies_on_its_law(wheels):
    ax = plots.characteristic(wheels, "interface")
    assert ax.get_ylabel() == FORCE
    w, force = curve(ax, "trajectory").get_data()
    assert np.all(force[w < 0] == -10.0)
    static = [line for line in ax.get_lines() if list(line.get_xdata()) == [0, 0]]
    assert list(static[0].get_ydata()) == [-20.0, 20.0]
    brake = plots.characteristic(wheels, "brake")
    assert brake.get_ylabel() == "force / normal force [1 | m]"
    w, ratio = curve(brake, "trajectory").get_data()
    assert ratio[(w > 1e-9) & np.isfinite(ratio)] == pytest.approx(0.1)
    # and its law per normal force: the kinetic coefficient on both sides, the static one at rest
    law = [line for line in brake.get_lines() if line.get_color() == "0.65"]
    assert [sorted(set(line.get_ydata())) for line in law] == [[-0.1], [0.1], [-0.2, 0.2], []]
    drawn(brake)


def test_characteristic_of_a_long_run_marks_some_of_its_times():
    """Thousands of marks would hide both the law and the trajectory."""
    scene = Scene(
        Body("block", inertia=1.0),
        Drive("belt", velocity=0.3),
        Spring("block", "belt", stiffness=30.0),
        Contact("rub", "block", GROUND, DryFriction(0.5, 0.3), normal=5.0),
    )
    ax = plots.characteristic(simulate(scene, (0.0, 200.0)), "rub")
    (label,) = [one for one in labels(ax) if one.startswith("times fit for a plot")]
    assert ", 1 in " in label
    assert 100 < curve(ax, label).get_xdata().size <= 300


@pytest.mark.parametrize(
    "law",
    [
        DryFriction(0.2, 0.1, stribeck_velocity=0.1),
        PreSlip(DryFriction(0.2, 0.1), velocity=0.05),
        PreSlip(DryFriction(0.2, 0.1), velocity=0.05, shape="tanh"),
        PreSlip(DryFriction(0.2, 0.1), velocity=0.05, shape="arctan"),
        Karnopp(DryFriction(0.2, 0.1)),
        LuGre(DryFriction(0.2, 0.1), stiffness=1e3),
    ],
    ids=lambda law: f"{type(law).__name__} {getattr(law, 'shape', '')}",
)
def test_characteristic_of_every_law(law):
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Contact("c", "a", GROUND, law, normal=10.0))
    result = simulate(scene, (0.0, 0.5))
    ax = plots.characteristic(result, "c")
    assert type(law).__name__ in labels(ax)
    forward = ax.get_lines()[1]
    w, force = curve(ax, "trajectory").get_data()
    if not isinstance(law, LuGre):  # its bristles deflect first
        assert force == pytest.approx(np.interp(w, *forward.get_data()), rel=1e-3)
    drawn(ax)


def test_energy_draws_the_ledger(wheels, blocks):
    ax = plots.energy(wheels)
    assert ax.get_ylabel() == "energy [J]"
    assert labels(ax) == ["kinetic", "heat of interface", "heat of brake"]
    heat = curve(ax, "heat of brake").get_ydata()
    assert heat[-1] == pytest.approx(energy(wheels).contacts["brake"][-1])
    assert "balance error" in ax.get_title(loc="left")
    assert "work of drives" in labels(plots.energy(blocks)) and "springs" in labels(plots.energy(blocks))


def test_energy_draws_what_gaps_store():
    """A body of 1 kg at 2 m/s is stopped by an elastic gap of 100 N/m: all of 2 J are in the gap at pi / 20 s."""
    gap = Gap("wall", "a", GROUND, upper=0.0, stiffness=100.0)
    ax = plots.energy(simulate(Scene(Body("a", inertia=1.0, velocity=2.0), gap), (0.0, 0.3)))
    stored = curve(ax, "springs").get_ydata()
    assert stored.max() == pytest.approx(2.0, rel=1e-4)


def test_results_without_dense_output_are_drawn_at_their_points():
    times = np.linspace(0.0, 1.0, 21)
    result = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=times, dense_output=False)
    assert np.array_equal(curve(plots.velocities(result), "wheel1").get_xdata(), times)
    plots.overview(result).draw_without_rendering()
    with pytest.raises(ValueError, match="dense_output=True"):
        plots.phase_portrait(result, "interface")
    many = simulate(flywheel_chain(20), (0.0, 1.0), t_eval=times, dense_output=False)
    assert raster(plots.velocities(many)).size == 20 * 21


def test_axes_given_are_the_axes_returned(wheels):
    for draw in (plots.velocities, plots.modes, plots.normal_forces, plots.energy, plots.load_of_contacts):
        ax = Figure().subplots()
        assert draw(wheels, ax=ax) is ax
    for draw in (plots.contact_forces, plots.phase_portrait, plots.characteristic):
        ax = Figure().subplots()
        assert draw(wheels, "brake", ax=ax) is ax


def test_long_names_leave_room_for_the_axes():
    """Matplotlib warns where it cannot lay out a figure, and warnings are errors here."""
    body, rub = "flywheel on the crankshaft, with the ring gear of the starter", "c" * 60
    contact = Contact(rub, body, GROUND, DryFriction(0.5, 0.5), normal=1.0)
    figure = plots.overview(simulate(Scene(Body(body, inertia=1.0, velocity=1.0), contact), (0.0, 4.0)))
    figure.draw_without_rendering()
    assert "flywheel on the …r of the starter" in [t.get_text() for t in figure.axes[0].get_legend().get_texts()]
    assert figure.axes[1].get_yticklabels()[0].get_text() == "c" * 16 + "…" + "c" * 16


@pytest.mark.slow
def test_every_label_is_text_that_the_font_has(chain, blocks):
    for figure in (plots.overview(chain), plots.overview(blocks)):
        assert sum(bool(text.get_text()) for text in figure.findobj(Text)) > 20
        figure.draw_without_rendering()  # a missing glyph would warn, and warnings are errors here


def test_sampling_keeps_the_limits_at_events(wheels):
    fine = wheels.fit_for_plot(1500)
    for event in wheels.events:
        assert np.count_nonzero(fine.t == event.t) == 2
    assert np.isin(wheels.t, fine.t).all()
    third = wheels.sample([0.05, 0.06])
    assert third.t == pytest.approx([0.05, 0.06])
    assert np.array_equal(third.y, wheels(third.t))


# -- axes of one's own, units and colours -------------------------------------------------------------------


def test_nothing_falls_outside_a_figure_that_makes_no_room(wheels, chain):
    drawings = [
        lambda ax: plots.velocities(wheels, ax=ax),
        lambda ax: plots.modes(wheels, ax=ax),
        lambda ax: plots.contact_forces(wheels, "brake", ax=ax),
        lambda ax: plots.energy(wheels, ax=ax),
        lambda ax: plots.velocities(chain, ax=ax),
        lambda ax: plots.modes(chain, ax=ax),
        lambda ax: plots.load_of_contacts(chain, ax=ax),
    ]
    for draw in drawings:
        figure = Figure(figsize=(6.4, 4.8))
        ax = figure.subplots()
        draw(ax)
        whole = figure.get_tightbbox(FigureCanvasAgg(figure).get_renderer())
        assert whole.x0 >= 0 and whole.y0 >= 0 and whole.x1 <= 6.4 and whole.y1 <= 4.8


def test_names_within_the_axes_stand_before_the_strips(wheels):
    ax = plots.modes(wheels, ax=Figure().subplots())
    assert [label.get_text() for label in ax.get_yticklabels()] == ["interface", "brake"]
    assert ax.yaxis.get_zorder() > max(strip.get_zorder() for strip in ax.collections)


@pytest.mark.parametrize(("motion", "velocity", "force"), [("rotation", "rad/s", "N m"), ("translation", "m/s", "N")])
def test_only_the_unit_that_applies_is_shown(motion, velocity, force):
    result = simulate(Scene(*flywheel_benchmark().elements, motion=motion), (0.0, 1.0))
    shown = [ax.get_ylabel() for ax in plots.overview(result).axes]
    forces = [f"force [{force}]"] * 2
    assert shown == [f"velocity [{velocity}]", "mode", *forces, "normal force [N]"]
    portrait = plots.phase_portrait(result, "interface")
    assert portrait.get_xlabel() == f"relative displacement [{velocity.removesuffix('/s')}]"
    arm = "[m]" if motion == "rotation" else "[1]"
    assert plots.characteristic(result, "brake").get_ylabel() == f"force / normal force {arm}"


def test_no_colour_stands_twice_in_a_panel():
    bodies = [Body(f"b{k}", inertia=1.0, velocity=1.0 + k) for k in range(12)]
    result = simulate(Scene(*bodies), (0.0, 1.0))
    lines = [line for line in plots.velocities(result).get_lines() if line.get_label().startswith("b")]
    assert len({line.get_color() for line in lines}) == 12


def test_a_few_extremes_do_not_stretch_the_colours_of_a_raster():
    axes = Figure(layout="constrained").subplots(2, 1)
    t = np.linspace(0.0, 1.0, 300)
    rows = np.tile(np.sin(6 * t), (4, 1))
    value_raster(axes[0], t, rows, list("abcd"), "velocity")
    assert axes[0].collections[0].get_clim() == (rows.min(), rows.max())
    rows[2, 150] = 1000.0
    value_raster(axes[1], t, rows, list("abcd"), "velocity")
    low, high = axes[1].collections[0].get_clim()
    assert high == pytest.approx(1.0, abs=0.01) and low == pytest.approx(-1.0, abs=0.01)
    assert axes[1].collections[0].colorbar.extend == "both"


def test_gaps_and_stops_show_their_stretch_between_limits() -> None:
    from stickslip import GROUND, Body, Gap, Scene, Stop, simulate

    scene = Scene(
        Body("m", inertia=1, velocity=1.0),
        Stop("wall", "m", GROUND, lower=-1, upper=1, restitution=0.5),
        Gap("soft", "m", GROUND, lower=-0.5, stiffness=10.0),
    )
    result = simulate(scene, (0, 12))
    ax = plots.stretch(result, "wall")
    assert len(ax.patches) == 2
    labels = [line.get_label() for line in ax.lines]
    assert "impact" in labels
    assert len(plots.stretch(result, "soft").patches) == 1
    titles = [panel.get_legend().get_title().get_text() for panel in result.plot().axes if panel.get_legend()]
    assert "stop wall" in titles
    assert "gap soft" in titles
    assert plots.schematic(scene)
    with pytest.raises(ValueError, match="no gap or stop is called 'other'; known are 'soft', 'wall'"):
        plots.stretch(result, "other")


def test_blocks_show_their_outputs_and_states() -> None:
    lag = StateSpace("lag", [[-1.0]], [[1.0]], [[1.0]], inputs=[TIME])
    steps = Sampled(
        "steps",
        period=0.5,
        inputs=[velocity("a")],
        states=[0.0, 1.0],
        update=lambda t, x, u: [x[0] + 1, 2.0],
        output=lambda t, x, u: x[0],
    )
    result = simulate(Scene(Body("a", inertia=1.0), lag, steps, Force("a", output("lag"))), (0.0, 2.0))
    ax = plots.block(result, "steps")
    assert [line.get_label() for line in ax.lines] == ["output", "state 0", "state 1"]
    x, y = ax.lines[0].get_data()
    # held between samples: vertical at them
    assert np.all((np.diff(y) == 0) | (np.diff(x) == 0))
    # the state of the lag is its output
    assert len(plots.block(result, "lag").lines) == 1
    labels = [panel.get_ylabel() for panel in plots.overview(result).axes]
    assert labels[1:] == ["lag", "steps"]
    with pytest.raises(ValueError, match="no block is called 'other'"):
        plots.block(result, "other")


def test_names_are_no_formulas_and_none_is_missing_in_the_legend(tmp_path: Path) -> None:
    names = ["a$$b", "pump $5 or $6", "$\\frac{$", "_left"]
    bodies = [Body(name, inertia=1.0, velocity=1.0 + k) for k, name in enumerate(names)]
    contacts = [
        Contact(f"c{body.name}", body.name, GROUND, DryFriction(0.3, 0.2), normal=sine(0.1, 1.0, offset=1.0))
        for body in bodies
    ]
    result = simulate(Scene(*bodies, *contacts), (0.0, 1.0))
    figure = result.plot()
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert legend[:4] == names
    figure.savefig(tmp_path / "names.png")
    result.scene.draw().savefig(tmp_path / "scene.png")
    for contact in contacts:
        plots.characteristic(result, contact.name).figure.savefig(tmp_path / "law.png")
    assert "pump $5 or $6" in result.scene._repr_html_()
    result.report(tmp_path / "names.html")


@pytest.mark.parametrize("count", [2, 5, 13])
def test_a_run_that_failed_at_its_start_is_refused_whatever_its_size(count: int) -> None:
    names = [f"b{k}" for k in range(count)]
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=1.0) for name in names),
        *(Contact(f"c{name}", name, GROUND, DryFriction(0.3, 0.2), normal=1.0) for name in names),
        Force("b0", feedback(lambda t: math.nan, TIME)),
    )
    with pytest.raises(SimulationError) as caught:
        simulate(scene, (0.0, 1.0))
    result = caught.value.result
    for name, draw in {
        "overview": result.plot,
        "velocities": lambda: plots.velocities(result),
        "modes": lambda: plots.modes(result),
        "normal_forces": lambda: plots.normal_forces(result),
        "load_of_contacts": lambda: plots.load_of_contacts(result),
    }.items():
        with pytest.raises(ValueError, match=f"{name}: nothing was kept: the run failed at its start"):
            draw()
    with pytest.raises(ValueError, match="share of 'cb0': nothing was kept: the run failed at its start"):
        result.share("cb0")


def test_an_overview_of_nothing_is_refused_and_a_grid_of_axes_is_counted() -> None:
    result = simulate(Scene(Body("a", inertia=1.0, velocity=1.0)), (0.0, 1.0))
    with pytest.raises(ValueError, match="overview: nothing is asked for that could be drawn"):
        result.plot(bodies=[], contacts=[])
    with pytest.raises(ValueError, match="overview: 1 panels need as many axes, got 4"):
        result.plot(axes=Figure().subplots(2, 2))


def test_a_phase_portrait_says_what_it_is_of() -> None:
    scene = Scene(
        Body("a", inertia=1.0, velocity=2.0),
        Body("b", inertia=1.0, velocity=1.0),
        Gear("g", "a", "b", ratio=2.0),
    )
    ax = plots.phase_portrait(simulate(scene, (0.0, 1.0)), "g")
    assert ax.get_legend().get_title().get_text() == "gear g"
