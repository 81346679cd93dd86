"""The model's one text compiled by numba: many vehicles at once, or one."""
