"""What several benchmarks need: the project's data, which is not in the repository, and overlap."""

import argparse
import sys
from pathlib import Path

from shapely.geometry.base import BaseGeometry

DATA = Path(__file__).parents[2] / "shared" / "data"


def data_folder(name: str, doc: str | None) -> Path:
    """The folder of that name below ``--data``, the only option."""
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("--data", type=Path, default=DATA, help="(default: ../shared/data)")
    return check_folder(parser.parse_args().data / name)


def check_folder(folder: Path) -> Path:
    """The folder; ends the program in one line if it is not there."""
    if not folder.is_dir():
        sys.exit(f"{folder}: no such folder; give the one that holds {folder.name} with --data")
    return folder


def overlap(a: BaseGeometry, b: BaseGeometry) -> float:
    """Intersection over union of two areas."""
    return float(a.intersection(b).area / a.union(b).area)
