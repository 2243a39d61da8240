"""Limit cycles: found, followed over a parameter, and where their branches turn, split and end."""
