"""The run as a whole: up, down, status, init."""
