"""One name for two things: a quantity of a block, and functions that write results."""

from __future__ import annotations

from stickslip.model.quantities import output as output_of
from stickslip.results import files, tables


class _Output:
    """``output(block)`` is a quantity; ``output.to_csv`` and others like it write results."""

    __call__ = staticmethod(output_of)
    columns = staticmethod(tables.columns)
    column_units = staticmethod(tables.column_units)
    summary = staticmethod(tables.summary)
    to_csv = staticmethod(tables.to_csv)
    to_json = staticmethod(tables.to_json)
    to_frame = staticmethod(tables.to_frame)
    save = staticmethod(files.save)
    read = staticmethod(files.read)


# ``output(block, index=0)`` is output `index` of a block, as a quantity; ``output.to_csv(result, path)`` and others
# like it write results.
output = _Output()
