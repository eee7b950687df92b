"""Tests of the benchmark of posteriors."""
