"""A two-link planar arm in a vertical plane."""
