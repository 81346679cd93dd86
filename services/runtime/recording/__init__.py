"""Recordings: MCAP files that any viewer opens and that are read back bit for bit."""
