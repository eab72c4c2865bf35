"""Results of the action's paper: features, tables, figures, and the report of all."""
