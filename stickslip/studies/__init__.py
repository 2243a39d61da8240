"""Many runs and what follows from them: sweeps, trade-offs, derivatives, limit cycles, linear models, fits."""
