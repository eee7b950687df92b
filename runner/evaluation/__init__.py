"""How rows are evaluated: batches, retries, solver processes, and adaptive runs that ask for rows as they go."""
