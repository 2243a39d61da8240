"""How a scene moves while its modes hold."""
