"""`quadctl service`: what can be called."""
