"""What nodes learn of a session: strikes announced, sounded, lost or refused; the devices'
clocks.
"""
