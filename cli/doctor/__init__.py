"""`quadctl doctor`: everything that can be wrong."""
