"""The Zenoh router, in a process of its own."""
