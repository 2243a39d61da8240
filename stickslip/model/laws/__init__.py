"""Friction laws: their coefficients as frozen data, and what they say of forces."""
