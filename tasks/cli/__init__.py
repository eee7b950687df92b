"""The command ``sinew``."""
