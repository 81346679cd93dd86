"""Parameters: one checked object from file, command line and running system, and back."""
