"""`quadctl bag`: recordings."""
