"""Pekedis (2025), reproduced on specimens whose truth is known."""
