"""What came out of a simulation."""
