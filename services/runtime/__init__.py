"""What every process shares: bus, parameters, entry point, supervisor. Alone imports zenoh."""
