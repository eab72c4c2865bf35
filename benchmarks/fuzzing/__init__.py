"""What ``benchmarks/fuzz.py`` throws at the doors of the package, and what it asks of each."""
