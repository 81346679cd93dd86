"""`quadctl demo`: the whole lab."""
