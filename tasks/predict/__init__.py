"""Bands around the curves from the posterior."""
