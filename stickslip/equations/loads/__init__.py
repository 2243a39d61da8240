"""Loads as one vector of inputs: signals over time, and what depends on the state."""
