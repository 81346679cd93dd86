"""Zenoh as everybody here uses it: sessions, the ends of topics and services, and who is there."""
