"""Recorder of the messages on the bus."""
