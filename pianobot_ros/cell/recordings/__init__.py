"""What is played and recorded: commands, signals, keystrokes (Eq. 2, Eq. 5), and how two recordings
are compared.
"""
