"""The twin as it is declared, and as it is called."""
