"""The solver FEBio: its input, its runs, its output."""
