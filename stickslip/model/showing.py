"""How scenes are shown: by functions that the package registers, because the model knows no drawings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

__all__ = ["register", "shown_by"]

_SHOWN: dict[str, Callable[..., Any]] = {}


def register(way: str, show: Callable[..., Any]) -> None:
    """Let a function show scenes in a way: "draw" or "html"."""
    _SHOWN[way] = show


def shown_by(way: str) -> Callable[..., Any]:
    """Return the function that shows scenes in a way."""
    return _SHOWN[way]
