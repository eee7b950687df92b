"""Clusters of workers: on this machine, in an allocation, or as jobs of a batch system."""
