"""The model in motion: a cell that runs, its departures from the nominal laws, strikes offline."""
