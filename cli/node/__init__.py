"""`quadctl node`: the processes on the bus."""
