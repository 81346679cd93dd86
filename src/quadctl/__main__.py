"""`python -m quadctl`: the command line."""

from quadctl.cli.main import main

main()
