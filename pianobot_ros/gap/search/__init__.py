"""Hypotheses on the table: which effects deserve a full fit, alone and together."""
