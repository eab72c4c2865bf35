"""The two cells in three dimensions."""
