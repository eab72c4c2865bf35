"""What is asked: blocks, twin and options, checked, and laid out as flat vectors."""
