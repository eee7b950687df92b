"""Measured curves: cohorts, machines' exports, their units and columns, and the noise of the curves."""
