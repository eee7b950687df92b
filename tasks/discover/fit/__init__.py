"""Fits of the model with and without effects, to every specimen."""
