"""Shell completion from the declarations of the commands, without Typer."""
