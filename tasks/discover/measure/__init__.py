"""Where model and measurement disagree, and by how much more than noise."""
