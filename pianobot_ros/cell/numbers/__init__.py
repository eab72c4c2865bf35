"""Numbers of the cell from files: `config/` with units and sources, the nominal laws, and how files
that people write are read within bounds.
"""
