"""Random forest importance."""
