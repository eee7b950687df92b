"""Posteriors of specimens and populations from the likelihood of every measured curve, in one hierarchical model."""
