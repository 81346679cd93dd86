"""A campaign's processes: one that gives out batches of flights, and its workers."""
