"""Advance a motion to its first event."""
