"""Effects of sensing and clock: between motion and what is reported."""
