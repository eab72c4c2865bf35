"""The UR5 arm: a driver around the client library ``ur_rtde``, which runs in a process of its
own. Nothing is imported here, so that this process is soon there.
"""
