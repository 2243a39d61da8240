"""Scenes that draw themselves: the model knows no drawings, so they are handed to it here, loaded when asked for."""

from __future__ import annotations

from typing import Any

from stickslip.model.scene import Scene


def draw(scene: Scene, *, ax: Any = None) -> Any:
    """Return the figure of a scene's schematic."""
    from stickslip.plots.schematic import schematic

    return schematic(scene, ax=ax).figure


def html(scene: Scene) -> str:
    """Return a scene as notebooks show it."""
    from stickslip.plots.notebook import scene_html

    return scene_html(scene)


def let_scenes_show_themselves() -> None:
    """Let scenes draw themselves, and show themselves in notebooks."""
    Scene.shown_by.update(draw=draw, html=html)
