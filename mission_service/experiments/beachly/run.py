"""Run the experiments of Beachly et al.: trajectories (section VI), corrections (section VII)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from mission_service.experiments.beachly.corrections import (
    FIRES,
    PARTICIPANTS,
    Study,
    rows_of,
    study,
)
from mission_service.experiments.beachly.maria import maria_rows
from mission_service.experiments.beachly.trajectories import fly, row_of
from mission_service.experiments.beachly.truth import random_burn

Progress = Callable[[str], None]


def run(out: Path | None, progress: Progress) -> dict[str, Any]:
    """Run both experiments; if ``out`` is given, draw figs. 6, 7, 10 and 11 in that folder."""
    return {
        "trajectories": run_trajectories(out, progress),
        "corrections": run_corrections(out, progress),
    }


def run_trajectories(out: Path | None, progress: Progress) -> list[dict[str, Any]]:
    """Fly all four scenarios; if ``out`` is given, draw figs. 6 and 7 in that folder."""
    rows = []
    for number in (1, 2, 3, 4):
        flown = fly(number, out)
        progress(f"scenario {number}: {len(flown.spheres)} drops")
        rows.append(row_of(flown))
        if out is not None:
            from mission_service.experiments.beachly.trajectory_figures import draw_trajectory

            draw_trajectory(out / f"scenario-{number}.png", flown)
    return rows


def run_corrections(
    out: Path | None,
    progress: Progress,
    fires: tuple[int, ...] = FIRES,
    participants: int = PARTICIPANTS,
) -> list[dict[str, Any]]:
    """Run all fires (Maria only if its data exists); if ``out`` is given, draw figures there."""
    studies: list[Study] = []
    for number, seed in enumerate(fires, 1):
        studies += study(random_burn(seed), participants)
        progress(f"corrections of fire {number} of {len(fires)}")
    rows = [row for one in studies for row in rows_of(one)]
    rows += maria_rows(progress)
    if out:
        from mission_service.experiments.beachly.correction_figures import draw

        draw(out, studies)
    return rows
