"""``pianobot demo``: the whole system on an emulated cell."""
