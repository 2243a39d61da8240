"""How long things take. Nothing here is a test: numbers are printed, and depend on the machine."""
