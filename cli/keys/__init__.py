"""Certificates of a fleet."""
