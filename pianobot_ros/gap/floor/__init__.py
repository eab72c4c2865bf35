"""The repeatability floor: what repeats differ by, and the gap in its units."""
