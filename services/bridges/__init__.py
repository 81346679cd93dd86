"""Bridges to other networks: their common part, and a package for each."""
