"""Pieces of HTML: tables, and figures that stand in the page itself."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from matplotlib import rc_context

STYLE = """
<style>
.stickslip table { border-collapse: collapse; font-size: 0.9em; margin: 0.4em 0; }
.stickslip th, .stickslip td { text-align: left; vertical-align: top; padding: 0.15em 0.7em;
  border-bottom: 1px solid #ccc; }
.stickslip td.number { text-align: right; font-variant-numeric: tabular-nums; }
.stickslip img, .stickslip svg { max-width: 100%; height: auto; background: white; }
.stickslip .wide { overflow-x: auto; }
</style>
"""


def table(heads: Sequence[str], rows: Iterable[Sequence[Any]], count: int = 0) -> str:
    """Return a table of texts and numbers; numbers stand to the right, with as many digits as help a reader.

    If there are more rows, `count` in all, the last line says how many are left out.
    """
    lines = ["<tr>" + "".join(f"<th>{escape(head)}</th>" for head in heads) + "</tr>"]
    lines += ["<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows]
    if (left := count + 1 - len(lines)) > 0:
        lines.append(f'<tr><td colspan="{len(heads)}">and {left} more</td></tr>')
    return '<div class="wide"><table>' + "\n".join(lines) + "</table></div>"


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return f"<td>{escape(value)}</td>"
    return f'<td class="number">{value:.9g}</td>'


def vector(figure: Any, describes: str) -> str:
    """Return a figure as SVG for a page, with a text for those who cannot see it."""
    file = io.StringIO()
    with rc_context({"svg.fonttype": "path"}):
        figure.savefig(file, format="svg", metadata={"Date": None})
    svg = file.getvalue()
    svg = svg[svg.index("<svg") :]
    # metadata of a file have no place in a page
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(describes)}" ', 1)


def bitmap(figure: Any, describes: str, dpi: int = 90) -> str:
    """Return a figure as PNG within a page, with a text for those who cannot see it."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=dpi)
    data = base64.b64encode(file.getvalue()).decode("ascii")
    return f'<img alt="{escape(describes)}" src="data:image/png;base64,{data}">'
