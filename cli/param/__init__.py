"""`quadctl param`: parameters of the running system."""
