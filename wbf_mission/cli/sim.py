"""``wbf-mission sim``."""

import typer

EXAMPLES = ""


def sim_command() -> None:
    """Placeholder while the server lands."""
    raise typer.Exit(0)
