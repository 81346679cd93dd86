"""`quadctl topic`: what is published."""
