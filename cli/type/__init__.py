"""`quadctl type`: messages and services, field by field."""
