"""Many runs: work and precision, sweeps, the trade between speed and accuracy."""
