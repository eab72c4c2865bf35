"""A pneumatic cylinder with a proportional valve."""
