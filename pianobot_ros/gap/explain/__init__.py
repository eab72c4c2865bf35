"""What is said of a verdict: tables, traces, shares, the unknown, the next experiment."""
