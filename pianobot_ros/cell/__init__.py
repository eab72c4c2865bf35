"""What a cell is: geometry, parameters with units and sources, motions, recordings and keystrokes.
Pure: no ROS here.
"""
