"""Lines of text that are no rows of a table, and what a single cell or word says."""
