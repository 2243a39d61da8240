"""Matrices, polynomials and sums written out: nothing of friction."""
