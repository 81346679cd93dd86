"""`quadctl record` and `replay`."""
