"""Each specimen's best parameters."""
