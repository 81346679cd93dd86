"""Zenoh for all processes: sessions, publishers, subscribers, clients, servers and liveliness."""
