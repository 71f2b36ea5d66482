"""``mission-service token``: a token for somebody. Heavy imports wait for the command."""

from pathlib import Path

import click

ROLES = ("look", "correct", "fly", "approve")


@click.command()
@click.argument("name")
@click.option(
    "--roles",
    default="look",
    show_default=True,
    metavar="ROLE,...",
    help=f"What it is for: {', '.join(ROLES)}. All may look, and abort.",
)
@click.option("--station", default="", metavar="NAME", help="Where they are, for burns.")
@click.option(
    "--file",
    "path",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    help="The tokens file it is added to (made if need be).",
)
def token(name: str, roles: str, station: str, path: Path) -> None:
    """Make a token for NAME, and print it once: only its SHA-256 sum is kept.

    A running service takes the file's tokens as soon as it changes. To take one back, remove its
    lines.
    """
    from mission_service.interfaces.api.access.token_file import added

    click.echo(added(path, name, tuple(roles.split(",")), station))
