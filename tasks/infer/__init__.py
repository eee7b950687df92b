"""Each site's posterior by approximate Bayesian computation."""
