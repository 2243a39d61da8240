"""CVODE and IDA as scikit-sundae has them, but silent. The only importer of sksundae, which it loads when first used.

A failure comes back as a status; the messages of SUNDIALS about it go to the logger "stickslip.sundials" at level
DEBUG. Otherwise warnings would go to stderr, and scikit-sundae would `print` errors, which spoils the output of a
script to stdout.
"""

from __future__ import annotations

import builtins
import logging
import os
import warnings
from functools import cache
from typing import Any

_LOGGER = logging.getLogger("stickslip.sundials")


def CVODE(rate: Any, **options: Any) -> Any:
    """Return scikit-sundae's CVODE for a right-hand side."""
    return _made(0, rate, options)


def IDA(residual: Any, **options: Any) -> Any:
    """Return scikit-sundae's IDA for a residual."""
    return _made(1, residual, options)


def _made(which: int, function: Any, options: dict[str, Any]) -> Any:
    with warnings.catch_warnings():
        # scikit-sundae warns where a pattern is given together with a Jacobian, but both are needed
        warnings.simplefilter("ignore", UserWarning)
        return _loaded()[which](function, **options)


@cache
def _loaded() -> tuple[Any, Any]:
    os.environ.setdefault("SUNLOGGER_WARNING_FILENAME", os.devnull)
    # Compiled modules look up builtins once, when they are first imported: this one is to find another `print`. It
    # prints in its handler of SUNDIALS' errors and nowhere else.
    kept, builtins.print = builtins.print, _note
    try:
        import sksundae._cy_common  # noqa: F401
    finally:
        builtins.print = kept
    from sksundae import cvode, ida

    return cvode.CVODE, ida.IDA


def _note(*words: Any, **_: Any) -> None:
    """Log what scikit-sundae would print."""
    _LOGGER.debug(" ".join(map(str, words)).strip())
