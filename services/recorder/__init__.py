"""Records what is said on the bus."""
