"""Which modes come next: pure functions."""
