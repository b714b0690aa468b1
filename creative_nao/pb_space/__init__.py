"""pb_space."""
