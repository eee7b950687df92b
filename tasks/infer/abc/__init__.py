"""Posterior of each site's parameters by approximate Bayesian computation (ABC-SMC), the method of Pekedis (2025)."""
