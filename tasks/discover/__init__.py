"""Where model and data disagree, what is missing, the model with it, and the gap before and after."""
