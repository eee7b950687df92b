"""Elementary effects (Morris): a cheap screening before a Sobol study."""
