"""The encrypted side of the hub, in a process of its own."""
