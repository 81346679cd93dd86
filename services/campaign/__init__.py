"""Thousands of random flights on the live automaton and dynamics, and their score."""
