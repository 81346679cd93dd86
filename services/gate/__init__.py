"""Encrypted side of the hub, as a separate process."""
