"""`quadctl fault`: what goes wrong, to order."""
