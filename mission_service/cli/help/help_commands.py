"""Defines ``completion``, ``man`` and ``config schema``: help in shells and editors."""

import json
from copy import copy
from pathlib import Path

import click
from click.shell_completion import get_completion_class

from mission_service import __version__
from mission_service.cli.options import OUT_FOLDER
from mission_service.cli.output_folder import output_folder

PROGRAM = "mission-service"
MAX_SHORT_HELP = 200  # characters
VARIABLE = "_MISSION_SERVICE_COMPLETE"  # read by click's completion


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print a script that completes commands, options and their values in SHELL.

    Write the script to the file from which the shell loads completions:

    \b
    bash:  ~/.local/share/bash-completion/completions/mission-service
    zsh:   _mission-service in a folder of $fpath
    fish:  ~/.config/fish/completions/mission-service.fish
    """
    made = get_completion_class(shell)
    assert made is not None  # click supports these shells
    root = click.get_current_context().find_root().command
    click.echo(made(root, {}, PROGRAM, VARIABLE).source())


@click.command()
@OUT_FOLDER
def man(out: Path) -> None:
    """Write a manual page for each command to DIR, for example ~/.local/share/man/man1."""
    from click_man.core import write_man_pages

    root = click.get_current_context().find_root().command
    whole = _with_all_commands(root, click.Context(root, info_name=PROGRAM))
    write_man_pages(PROGRAM, whole, version=__version__, target_dir=output_folder(out))
    click.echo(f"Wrote {len(list(out.glob(f'{PROGRAM}*.1')))} manual pages to {out}/")


@click.command("schema")
def config_schema() -> None:
    """Print the JSON Schema of scenario files, for completion and checks in editors.

    Editors with Taplo (Even Better TOML) read it if the first line of a scenario is
    "#:schema ./scenario.schema.json".
    """
    from mission_service.config.scenario_schema import scenario_schema

    click.echo(json.dumps(scenario_schema(), indent=2))


def _with_all_commands(command: click.Command, context: click.Context) -> click.Command:
    """Return a command with all its subcommands, including those made from a table.

    The short help of each is the first sentence of its help, which click-man would truncate.
    """
    short = command.get_short_help_str(limit=MAX_SHORT_HELP)
    if not isinstance(command, click.Group):
        leaf = copy(command)
        leaf.short_help = short
        return leaf
    commands = {}
    for name in command.list_commands(context):
        found = command.get_command(context, name)
        if found is not None:
            inner = click.Context(found, context, info_name=name)
            commands[name] = _with_all_commands(found, inner)
    return click.Group(
        command.name, commands, params=command.params, help=command.help, short_help=short
    )
