"""Who watches both cells: the monitor, the recorder, the viewer, and the command line's
observer.
"""
