"""One joint's samples made comparable: mended, smoothed on an even grid, cut into blocks."""
