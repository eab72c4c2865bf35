"""What the headers of a log say, in the words of many laboratories."""
