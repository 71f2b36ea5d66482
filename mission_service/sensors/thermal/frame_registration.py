"""Register the images of one pass to each other as the images arrive.

Each image is matched to the preceding images (``frame_matching``), and the poses of the latest
images are adjusted together (``pose_adjustment``). The result is the adjusted pose of the newest
image; the earlier images have already been used.
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from firemodel.arrays import Floats
from firemodel.errors import FireModelError
from firemodel.landscape.landscape import Landscape
from mission_service.sensors.thermal.camera_geometry import CameraPose, moved
from mission_service.sensors.thermal.frame_matching import Frame, Match, ties_between
from mission_service.sensors.thermal.pose_adjustment import adjusted

FRAMES = 8  # images of the pass that are adjusted together
PARTNERS = 3  # earlier images that an image is matched to
MAX_AGE_S = 60.0  # maximum age of the earlier images


class RegisteredPose(NamedTuple):
    """A pose after the adjustment."""

    pose: CameraPose
    covariance: Floats  # (6, 6) of its error, see ``PoseErrors``
    matches: int  # tie points with earlier images


class FrameRegistration:
    """The latest images of one camera."""

    def __init__(self, landscape: Landscape) -> None:
        """Set the landscape, whose elevation is used."""
        self._landscape = landscape
        self._frames: list[Frame] = []
        self._matches: list[Match] = []

    def registered(self, frame: Frame) -> RegisteredPose:
        """Add an image, and return its adjusted pose, or its measured pose without tie points."""
        near = [each for each in self._frames if abs(frame.taken_s - each.taken_s) < MAX_AGE_S]
        self._frames = [*near[-FRAMES + 1 :], frame]
        present = {id(each) for each in self._frames}
        self._matches = [
            each for each in self._matches if {id(each.earlier), id(each.later)} <= present
        ]
        mine = []
        for earlier in self._frames[-2 : -2 - PARTNERS : -1]:
            ties = ties_between(self._landscape, earlier, frame)
            if ties is not None:
                mine.append(Match(earlier, frame, ties))
        self._matches += mine
        error, covariance = np.zeros(6), frame.errors.covariance()
        if mine:
            # An adjusted camera may be below the ground, or off the landscape.
            with suppress(FireModelError):
                error, covariance = adjusted(self._landscape, self._frames, self._matches)
        count = sum(each.ties.match_sd_m.size for each in mine)
        return RegisteredPose(moved(frame.pose, -error), covariance, count)
