"""From fits to a verdict, and how far it can be trusted."""
