"""What the files of the command line share."""

from pathlib import Path

import click

JSON = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")


def folder(out: Path) -> Path:
    """A folder that files can be written to, made if need be; raises MissionServiceError."""
    from tempfile import TemporaryFile

    from mission_service.errors import MissionServiceError

    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MissionServiceError(f"{out}: cannot be made: {error.strerror}") from None
    try:
        with TemporaryFile(dir=out):  # told now, not after an hour of burning
            pass
    except OSError as error:
        raise MissionServiceError(f"{out}: cannot be written to: {error.strerror}") from None
    return out
