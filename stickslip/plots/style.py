"""What all drawings share: units, line styles that differ in greyscale, legends beside the data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter
from numpy.typing import NDArray

from stickslip.model.arrays import Array
from stickslip.model.checks import names as checked_names
from stickslip.results.readable import Readable, check_result
from stickslip.results.trajectory import NOTHING_KEPT

TIME = "time [s]"
FINE = 1500  # about how many evenly spaced points curves have besides those fit for a plot
_COLUMNS = 800
STUDY = (9.0, 5.0)  # width and height in inches of a figure of a study
NORMAL = "normal force [N]"

WITH_DOTS = 300  # more computed points than this are not marked on the curves

# There are more colours than a panel has curves.
COLOURS = (
    *("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#7F6000", "#56B4E9", "#E69F00"),
    *("#5E3C99", "#8C1515", "#66A61E", "#01665E", "#1F3A93", "#B8A800", "#E7298A", "#A0522D"),
    *("#7570B3", "#999999", "#FB8072", "#66C2A5"),
)
LINES = ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)))
MARKERS = "osD^vPX*<>hp"
_MARKED_EVENTS = 40
_INSIDE = 8  # so many entries of a legend find room within the axes
_END = 16  # so many letters are shown of either end of a long name

# A colour scale is cut where the extremes are this many times as far apart as all but 2 % of the values.
_STRETCHED = 3.0


_ARE_PYPLOTS = ContextVar("whether new figures are pyplot's", default=True)


class Drawing(Figure):
    """A figure that notebooks show only once: as the value of a cell, or at its end, where pyplot shows its figures."""

    def _ipython_display_(self) -> None:
        import matplotlib.pyplot as plt

        if "inline" in plt.get_backend():
            plt.close(self)
        raise NotImplementedError  # this makes IPython show it like any other figure


def formats() -> list[str]:
    """Return the formats in which figures can be saved, as the ends of file names without the dot."""
    return list(Figure().canvas.get_supported_filetypes())


def name_of_points(result: Readable) -> str:
    """Return what legends call the times of a curve: without the motion between them, they are all that was kept."""
    return "times fit for a plot" if result.is_dense else "times that were kept"


def few(count: int, most: int) -> tuple[slice, str]:
    """Return which of many points are marked, `most` of them, and the note for the legend."""
    every = max(-(-count // most), 1)
    return slice(None, None, every), f", 1 in {every}" if every > 1 else ""


def new_figure(width: float, height: float, **options: Any) -> Figure:
    """Return a new figure in inches: one of pyplot, so that ``plt.show()`` shows it and ``plt.close()`` frees it."""
    if not _ARE_PYPLOTS.get():
        return Figure(figsize=(width, height), **options)
    import matplotlib.pyplot as plt

    return plt.figure(figsize=(width, height), FigureClass=Drawing, **options)


@contextmanager
def apart_from_pyplot() -> Iterator[None]:
    """Within this, new figures are not pyplot's: pages and files are made without windows, and leave nothing behind."""
    before = _ARE_PYPLOTS.set(False)
    try:
        yield
    finally:
        _ARE_PYPLOTS.reset(before)


P = ParamSpec("P")
T = TypeVar("T")
SomeResult = TypeVar("SomeResult", bound=Readable)


def of_result(draw: Callable[P, T]) -> Callable[P, T]:
    """Make a drawing refuse an argument that is no result, or a result without motion."""

    @wraps(draw)
    def checked(*args: P.args, **given: P.kwargs) -> T:
        result = args[0] if args else given.get("result")
        check_result(result, draw.__name__)
        runs = result.runs  # type: ignore[attr-defined]
        if not any(run.success or run.trajectory.pieces for run in runs):
            raise ValueError(f"{draw.__name__}: {NOTHING_KEPT}")
        return draw(*args, **given)

    return checked


def own_axes(ax: Any, width: float = 7.5, height: float = 3.2) -> Any:
    """Return the axes given, or those of a new figure; call it after all checks, so that no empty figure is left."""
    if ax is None:
        return new_figure(width, height, layout="constrained").subplots()
    if not isinstance(ax, Axes):
        raise TypeError(f"ax must be axes of matplotlib, got {ax!r}; plt.subplots() returns a figure and its axes")
    return ax


def short_numbers(ax: Any) -> None:
    """Write small and large numbers beside the horizontal axis with a common power of ten, so that they have room."""
    if isinstance(formatter := ax.xaxis.get_major_formatter(), ScalarFormatter):
        formatter.set_powerlimits((-2, 4))


def look(k: int) -> dict[str, Any]:
    """Return colour and line style of the k-th curve; broken lines are thinner than whole ones."""
    width = 1.9 if k % len(LINES) == 0 else 1.4
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": LINES[k % len(LINES)], "linewidth": width}


def dots(k: int) -> dict[str, Any]:
    """Return how the k-th curve's computed points are marked."""
    marker = MARKERS[k % len(MARKERS)]
    return {"color": COLOURS[k % len(COLOURS)], "linestyle": "none", "marker": marker, "markersize": 3.5}


def short(text: str) -> str:
    """Return a text short enough to leave room for the axes: of a long one its two ends."""
    return text if len(text) <= 2 * _END + 1 else f"{text[:_END]}…{text[-_END:]}"


# How texts with names are drawn: a dollar in a name begins no formula.
AS_IT_IS: dict[str, Any] = {"parse_math": False}

_ZERO_WIDTH_SPACE = "\u200b"  # before a label that begins with an underscore, which legends leave out


def labelled(name: str) -> str:
    """Return the label of a curve with this name, which legends show even if it begins with an underscore."""
    return _ZERO_WIDTH_SPACE + name if name.startswith("_") else name


def beside(ax: Any, **options: Any) -> None:
    """Put the legend to the right of the axes; within them where nothing makes room beside them."""
    if not options and not ax.get_legend_handles_labels()[0]:
        return
    look = {"loc": "best", "framealpha": 0.8, "fontsize": "x-small"}
    if makes_room(ax):
        look = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.02), "frameon": False, "fontsize": "small"}
    legend = ax.legend(**look, **options)
    for text in (*legend.get_texts(), legend.get_title()):
        text.set(text=short(text.get_text().removeprefix(_ZERO_WIDTH_SPACE)), **AS_IT_IS)


def makes_room(ax: Any) -> bool:
    """Whether the figure moves its axes so that nothing beside them is cut off."""
    return ax.figure.get_layout_engine() is not None


def over_time(ax: Any, ylabel: str, title: str = "") -> Any:
    """Label axes over time, put the legend beside them, and return the axes."""
    ax.set_xlabel(TIME)
    ax.set_ylabel(ylabel, **AS_IT_IS)
    ax.margins(x=0.01)
    beside(ax, **({"title": title, "alignment": "left"} if title else {}))
    return ax


def even_points(result: SomeResult) -> SomeResult:
    """Return the result at evenly spaced times, enough for the columns of a picture."""
    return result.sample(_COLUMNS) if result.is_dense and result.t.size else result


def mark_events(ax: Any, result: Readable) -> None:
    """Draw a fine line at each event, unless there are too many to tell apart."""
    times = sorted({event.t for event in result.events})
    if len(times) <= _MARKED_EVENTS:
        for t in times:
            ax.axvline(t, color="0.7", linewidth=0.6, zorder=0)


def contact_names(result: Readable, contacts: Sequence[str] | None) -> list[str]:
    """Return the rows to draw: those asked for, else all contacts and other rows of the scene."""
    return wanted_names(result.scene.rows, contacts, "contacts", result.mode)


def wanted_names(
    elements: Iterable[Any], wanted: Sequence[str] | None, what: str, read: Callable[[str], Any]
) -> list[str]:
    """Return the names asked for, by default those of all elements; `read` raises the error for an unknown one."""
    known = [element.name for element in elements]
    if wanted is None:
        return known
    names = checked_names(wanted, what)
    for name in names:
        if name not in known:
            read(name)
    return names


def panels(axes: Any, heights: Sequence[float], what: str) -> list[Any]:
    """Return the axes given for the panels of a figure, or those of a new figure with panels of these heights."""
    count = len(heights)
    if not count:
        raise ValueError(f"{what}: nothing is asked for that could be drawn; name a body or a contact")
    if axes is None:
        figure = new_figure(9.0, 0.6 + sum(heights), layout="constrained")
        return list(figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])
    given = axes.ravel() if isinstance(axes, np.ndarray) else axes
    listed = list(given) if isinstance(given, Iterable) else [given]
    if len(listed) != count:
        raise ValueError(f"{what}: {count} panels need as many axes, got {len(listed)}")
    return [own_axes(ax) for ax in listed if ax is not None]


def edges(centres: Array) -> Array:
    """Return the edges of cells around rising centres."""
    if centres.size < 2:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    middles = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([centres[:1], middles, centres[-1:]])


def raster(ax: Any, t: Array, rows: NDArray[Any], names: list[str], **options: Any) -> Any:
    """Draw a row of colours per name over time, the first on top, and return the mesh."""
    if not t.size:
        t, rows = np.zeros(1), np.full((len(names), 1), np.nan)
    places = np.arange(len(names) + 1) - 0.5
    keep = np.concatenate([[True], np.diff(t) > 0])
    mesh = ax.pcolormesh(edges(t[keep]), places, rows[:, keep], rasterized=True, **options)
    ax.invert_yaxis()
    every = max(1, -(-len(names) // 12))
    listed = [short(name) for name in names[::every]]
    ax.set_yticks(range(0, len(names), every), listed, fontsize="small", **AS_IT_IS)
    keep_names_inside(ax)
    return mesh


def keep_names_inside(ax: Any) -> None:
    """Let the names at the left stand within the axes where nothing makes room beside them."""
    if makes_room(ax):
        return
    for label in ax.get_yticklabels():
        paper = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
        label.set(horizontalalignment="left", fontsize="x-small", bbox=paper)
    ax.tick_params(axis="y", pad=-4)
    ax.set_axisbelow(False)  # or strips would hide the names


def color_bar(ax: Any, mesh: Any, label: str, **options: Any) -> Any:
    """Draw the colour bar of a raster right beside its axes, whatever the panels above and below need; return it."""
    if makes_room(ax):
        options["cax"] = ax.inset_axes((1.015, 0.0, 0.02, 1.0))
    else:
        options["ax"] = ax
    return ax.figure.colorbar(mesh, label=label, **options)


def robust(values: Array) -> tuple[dict[str, float], str]:
    """Return limits of a colour scale that a few extremes do not stretch until all else looks alike.

    The text says at which ends of the colour bar an arrow shows that there are values beyond.
    """
    some = values[np.isfinite(values)]
    if not some.size:
        return {}, "neither"
    lowest, low, high, highest = np.quantile(some, [0.0, 0.01, 0.99, 1.0]).tolist()
    if not high > low or highest - lowest <= _STRETCHED * (high - low):
        return {}, "neither"
    ends = {(True, True): "both", (True, False): "min"}.get((lowest < low, highest > high), "max")
    return {"vmin": low, "vmax": high}, ends


def value_raster(ax: Any, t: Array, rows: Array, names: list[str], label: str) -> None:
    """Draw numbers as a raster with its colour bar."""
    limits, ends = robust(rows)
    color_bar(ax, raster(ax, t, rows, names, cmap="cividis", **limits), label, extend=ends)


def check_is(thing: Any, kind: str, what: str) -> None:
    """Raise a TypeError unless `thing` is of the class with the name `kind`: plots must not import studies."""
    if kind not in (one.__name__ for one in type(thing).__mro__):
        raise TypeError(f"{what}: expected a {kind}, got {type(thing).__name__}")


def is_crowded(ax: Any) -> bool:
    """Whether the legend has too many entries for the room within the axes."""
    return len(ax.get_legend_handles_labels()[1]) > _INSIDE


def within_or_beside(ax: Any) -> None:
    """Put the legend within the axes where there is room, else to their right."""
    crowded = is_crowded(ax)
    if not makes_room(ax):
        ax.legend(fontsize="xx-small" if crowded else "x-small", framealpha=0.8)
        return
    place = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)} if crowded else {}
    ax.legend(fontsize="small", **place)
