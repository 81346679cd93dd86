"""`quadctl topic`: the topics on the bus."""
