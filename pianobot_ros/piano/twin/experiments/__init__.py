"""The soft-hand paper's experiments (V-A, Figs. 7 and 8) on the twin, and its hand on the other
paper's action.
"""
