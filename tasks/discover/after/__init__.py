"""After the verdict: the model with the effect, the solver input, the next experiment."""
