"""Bridge to Foxglove and Lichtblick: the running system, live, over their WebSocket protocol."""
