"""The sections of the page, one module each: what a result folder holds of it, as blocks."""
