"""PAWN indices: sensitivity of the whole distribution, from the rows of the Sobol study."""
