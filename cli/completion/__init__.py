"""Completing words in a shell: read from the same declarations as a line is, without Typer."""
