"""Surrogates: emulators of forces and outputs along time, learned from few runs."""
