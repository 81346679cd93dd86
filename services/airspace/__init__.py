"""Space to fly in: geometry, cage, zones, routes, separation, stops and what may fly; pure."""
