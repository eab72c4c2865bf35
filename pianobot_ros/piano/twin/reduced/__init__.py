"""The reduced strike, one finger on one key, for searches; and recordings prepared for it."""
