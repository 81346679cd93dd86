"""`quadctl fly`: missions."""
