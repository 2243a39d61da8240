"""What holds for all tests: none leaves figures to the next, for pyplot warns of many."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def _closes_figures() -> Iterator[None]:
    """Close what was drawn, where anything was."""
    yield
    if (pyplot := sys.modules.get("matplotlib.pyplot")) is not None:
        pyplot.close("all")
