"""Bridges to other networks."""
