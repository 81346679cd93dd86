"""The wire contract: every message, service, topic and parameter, typed and bounded, once."""
