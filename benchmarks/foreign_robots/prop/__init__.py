"""A propeller on a thrust stand."""
