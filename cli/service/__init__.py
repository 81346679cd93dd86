"""`quadctl service`: the services on the bus."""
