"""Where outcomes are kept: a Zarr store per result folder that resumes after any interruption."""
