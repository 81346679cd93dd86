"""What of the recorder is not pure: its file."""
