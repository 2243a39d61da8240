"""CVODE and IDA as scikit-sundae has them, but silent. The only importer of sksundae.

What goes wrong comes back as a status; what SUNDIALS says about it besides goes to the logger "stickslip.sundials"
at level DEBUG. Left alone, warnings would go to stderr and scikit-sundae would `print` errors, which spoils what a
script writes to stdout.
"""

from __future__ import annotations

import builtins
import logging
import os
from typing import Any

__all__ = ["CVODE", "IDA"]

_LOGGER = logging.getLogger("stickslip.sundials")

os.environ.setdefault("SUNLOGGER_WARNING_FILENAME", os.devnull)


def _note(*words: Any, **_: Any) -> None:
    """Take what scikit-sundae would print."""
    _LOGGER.debug(" ".join(map(str, words)).strip())


# compiled modules look up builtins once, when they are first imported: this one is to find another `print`, which it
# uses in its handler of SUNDIALS' errors and nowhere else
_print = builtins.print
builtins.print = _note
try:
    import sksundae._cy_common  # noqa: F401
finally:
    builtins.print = _print

from sksundae.cvode import CVODE  # noqa: E402
from sksundae.ida import IDA  # noqa: E402
