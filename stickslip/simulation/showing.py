"""Scenes that draw themselves: the model knows no drawings, so they are handed to it here, loaded when asked for."""

from __future__ import annotations

from typing import Any

from stickslip.model.scene import Scene
from stickslip.model.showing import register

__all__ = ["attach", "draw", "html"]


def draw(scene: Scene, *, ax: Any = None) -> Any:
    """Return the figure of a scene's schematic."""
    from stickslip.plots.schematic import schematic

    return schematic(scene, ax=ax).figure


def html(scene: Scene) -> str:
    """Return a scene as notebooks show it."""
    from stickslip.plots.notebook import scene_html

    return scene_html(scene)


def attach() -> None:
    """Let scenes show themselves."""
    register("draw", draw)
    register("html", html)
