"""How often do posteriors hold the truth? Cohorts drawn from the prior, each inferred blind."""
