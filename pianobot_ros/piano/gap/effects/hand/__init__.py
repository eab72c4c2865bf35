"""Effects of the hand: in the fingers' joints."""
