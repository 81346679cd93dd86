"""The `quadctl` command."""
