"""A run of the system: its processes, started, watched, and ended together."""
