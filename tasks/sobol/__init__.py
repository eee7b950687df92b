"""Variance-based sensitivity indices."""
