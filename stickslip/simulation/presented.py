"""Results that explain, draw and write themselves: of one run, or of several in a row."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

from stickslip.model.checks import file_path
from stickslip.results import files, shares, tables
from stickslip.results.energy import EnergyLedger, energy
from stickslip.results.explanations import explain_result
from stickslip.results.outcome import Target
from stickslip.results.readable import Readable

if TYPE_CHECKING:
    from stickslip.plots import Figure


class Presented(Readable):
    """A motion that is read by name, and that explains, draws and writes itself."""

    share = shares.share
    save = files.save
    to_csv = tables.to_csv
    to_json = tables.to_json
    to_frame = tables.to_frame

    def energy(self) -> EnergyLedger:
        """Return where the energy went, and by how much the balance is off: a free check of accuracy.

        Raises
        ------
        ValueError
            If only the requested outputs were kept.
        """
        return self._ledger

    @cached_property
    def _ledger(self) -> EnergyLedger:
        return energy(self)

    def explain(self) -> str:
        """Return in words what was assembled, which guards were watched, and why each event happened."""
        return explain_result(self)

    def plot(
        self,
        *,
        bodies: Sequence[str] | None = None,
        contacts: Sequence[str] | None = None,
        t_span: tuple[float, float] | None = None,
        axes: Sequence[Any] | None = None,
    ) -> Figure:
        """Draw velocities, modes, contact forces against breakaway levels, and normal forces (the paper's fig. 8).

        Parameters
        ----------
        bodies, contacts : sequence of str, optional
            Names of those to draw; by default all.
        t_span : (float, float), optional
            Part of the time to draw, in s.
        axes : sequence of matplotlib axes, optional
            Where to draw, a panel each; by default a new figure.

        Raises
        ------
        ValueError
            If there is no such body or contact.
        """
        from stickslip import plots

        return plots.overview(self, bodies=bodies, contacts=contacts, t_span=t_span, axes=axes)

    def report(self, path: Target, *, title: str = "A simulation with dry friction") -> None:
        """Write a report of the run: one HTML file that needs no other file and no network.

        It shows the scene as a schematic, motion, modes and forces, the events with their causes, the part of the time
        in each mode, the energy ledger, and what is known of the accuracy. It can be read on a phone.

        Parameters
        ----------
        path : path
        title : str
            Heading of the page.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        from stickslip.plots.report import report

        if not isinstance(title, str):
            raise TypeError(f"report: title must be a text, got {title!r}")
        file_path(path, "report").write_text(report(self, title), encoding="utf-8")

    def _repr_html_(self) -> str:
        """Return figure, events and last velocities, as notebooks show them."""
        from stickslip.plots.notebook import result_html

        return result_html(self)
