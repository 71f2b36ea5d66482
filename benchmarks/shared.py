"""Locate the folder of reference data, which is not in the repository; print figures; overlaps."""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import click
from shapely.geometry.base import BaseGeometry

DATA = Path(__file__).parents[2] / "shared" / "data"


def data_parser(doc: str | None) -> argparse.ArgumentParser:
    """Return a parser of the command line with the option ``--data``."""
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("--data", type=Path, default=DATA, help="(default: ../shared/data)")
    return parser


def check_folder(folder: Path) -> Path:
    """Return the folder; exit with a message if it does not exist."""
    if not folder.is_dir():
        sys.exit(f"{folder}: no such folder; give the folder that contains it with --data")
    return folder


def print_figures(figures: Mapping[str, object], over: Sequence[str]) -> None:
    """Print figures as JSON; exit with a message if any limits are exceeded (``over``)."""
    click.echo(json.dumps(figures))
    if over:
        sys.exit("limits exceeded: " + "; ".join(over))


def overlap(a: BaseGeometry, b: BaseGeometry) -> float:
    """Return the intersection over union of two areas."""
    return float(a.intersection(b).area / a.union(b).area)
