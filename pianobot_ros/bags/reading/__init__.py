"""From the messages of a bag to a recording."""
