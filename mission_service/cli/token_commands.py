"""Defines ``mission-service token``, which creates a token for a user of the interfaces."""

from pathlib import Path

import click

ROLES = ("look", "observe", "correct", "fly", "approve")


@click.command()
@click.argument("name")
@click.option(
    "--roles",
    default="look",
    show_default=True,
    metavar="ROLE,...",
    help=f"Roles: {', '.join(ROLES)}. Every token permits an abort. Every token has the role look, "
    "except one with only the role observe.",
)
@click.option("--station", default="", metavar="NAME", help="Station of NAME, for burns.")
@click.option(
    "--file",
    "path",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    help="The tokens file to which the token is added (created if missing).",
)
def token(name: str, roles: str, station: str, path: Path) -> None:
    """Create a token for NAME and print it; the file contains only the token's SHA-256 sum.

    A running service reads the file again as soon as the file changes. To revoke a token, remove
    its lines from the file.
    """
    from mission_service.interfaces.api.access.token_file import added

    click.echo(added(path, name, tuple(roles.split(",")), station))
