"""What stands behind a verdict: error budget, convergence, seeded faults, relations."""
