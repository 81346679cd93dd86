"""The model compiled by numba from the same source: many vehicles at once, or one."""
