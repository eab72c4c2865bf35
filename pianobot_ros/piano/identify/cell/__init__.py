"""All that is unknown of a cell, in one fit: values, intervals, predictions, and the inverse."""
