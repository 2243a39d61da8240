"""Rows at the ends of every scale: a correct answer within a stated bound, or a clear error; never a hang."""

from validation import crowds, magnitudes

ROWS = [*magnitudes.ROWS, *crowds.ROWS]
