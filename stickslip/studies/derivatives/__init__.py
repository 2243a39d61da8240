"""How motions change with their start and their scene: first variations, exact through events."""
