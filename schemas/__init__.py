"""Wire contract: all messages, services, topics and parameters, typed and bounded."""
