"""Checks of the package against answers that owe it nothing."""
