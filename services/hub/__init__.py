"""Zenoh router, as a separate process."""
