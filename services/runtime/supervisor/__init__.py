"""Run of the system: its processes are started, supervised and ended together."""
