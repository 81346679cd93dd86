"""`quadctl fleet`: several vehicles at once, on one hub or on several machines."""
