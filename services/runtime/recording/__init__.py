"""Recordings: MCAP files, written so that any viewer opens them, and read back to the bit."""
