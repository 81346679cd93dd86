"""Parameters: from a file, the line and the running system to one checked object, and back."""
