"""Fits of one specimen: least squares and Bayesian optimisation, shared by the tasks that calibrate."""
