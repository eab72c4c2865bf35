"""Which tables are of one run, and which of them tell of joints."""
