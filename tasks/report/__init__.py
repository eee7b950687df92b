"""Figures of results, as PNG and PDF; drawn from ``TASK.json`` and the store, never from memory."""
