"""How evaluations run anywhere: clusters, batches, external processes, the store.

Nothing in here knows of tissue, of FEBio or of statistics, and nothing in here imports ``tasks``.
"""
