"""The model's one text on many vehicles at once: on numpy arrays, and compiled by numba."""
