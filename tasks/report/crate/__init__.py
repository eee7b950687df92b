"""A study with its data, results and environment as one RO-Crate, which a stranger can read and run again."""
