"""`quadctl fault`: faults put in on purpose."""
