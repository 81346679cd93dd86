"""`quadctl plot`: pictures of flights."""
