"""What of the barometer touches the bus, the clock and files."""
