"""Whether the sites can be told apart."""
