"""The process that holds the client library ``ur_rtde``. Nothing is imported here, so that it is
soon there.
"""
