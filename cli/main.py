"""Entry point of the `quadctl` command. Ctrl-C is no error, not even during the imports."""

import os

_CTRL_C = 130


def main() -> None:
    """Run the command line and exit with its exit code."""
    try:
        from quadctl.cli import command
    except KeyboardInterrupt:
        os._exit(_CTRL_C)
    command.main()


if __name__ == "__main__":
    main()
