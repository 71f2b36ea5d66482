"""Take georeferenced images from an MPEG transport stream of thermal video with metadata.

``VideoStream.feed`` receives the bytes of the stream in parts of any size, and returns the images.
``tstrans`` separates video and metadata. Each image gets the metadata whose presentation time is
nearest to that of the image, and the time in these metadata. ``counts`` contains the numbers of
received parts, and the last reasons why parts were not used. No clock, no socket, no thread.
"""

import math
from collections import deque
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np

from mission_service.config.fire_sections import ThermalVideoSection
from mission_service.errors import MissionServiceError
from mission_service.sensors.thermal.camera_geometry import focal_px_of
from mission_service.sensors.thermal.thermal_image import ThermalImage, is_coloured
from mission_service.sensors.video.video_decoder import (
    CODECS,
    STREAM_TYPES,
    VideoDecoder,
    VideoDecoderError,
)
from mission_service.sensors.video.video_metadata import (
    VideoMetadata,
    VideoMetadataError,
    is_continuous,
    is_uas_metadata,
    read_metadata,
)

if TYPE_CHECKING:
    from av import VideoFrame
    from tstrans.mpegts import Demuxer, DemuxEvent, StreamInfo

FRAME_EVERY_S = 1.0
NEAR_TICKS = 9_000  # at 90 kHz (0.1 s); maximum between an image and its metadata
KEPT = 100  # maximum number of metadata packets
PART_BYTES = 65_536
MIN_FIELD_OF_VIEW_DEG, MAX_FIELD_OF_VIEW_DEG = 1.0, 150.0
MAX_FIELD_ERROR = 0.1  # fraction of the vertical field of view


@dataclass
class StreamCounts:
    """The received parts of a stream, and the last reason why a part was not used."""

    size: int = 0  # bytes
    videos: int = 0  # video streams in the newest program map
    pictures: int = 0  # access units of video
    bad_pictures: int = 0
    picture_reason: str = ""
    metadata: int = 0  # packets of ST 0601, including damaged ones
    damaged_metadata: int = 0
    metadata_reason: str = ""
    lost: int = 0  # gaps in video or metadata
    images: int = 0  # images returned
    refused: int = 0  # images that were due, but could not be georeferenced
    refusal: str = ""


class VideoStream:
    """One transport stream; only its first video and the metadata of the same program are used."""

    def __init__(
        self, name: str, settings: ThermalVideoSection, every_s: float = FRAME_EVERY_S
    ) -> None:
        """Set the name of the video, and the time between two images."""
        self._name, self._settings = name, settings
        self._every = timedelta(seconds=every_s)
        self._demuxer = _demuxer()
        self._video: StreamInfo | None = None
        self._decoder: VideoDecoder | None = None
        self._is_cut = False  # the next access unit is incomplete
        self._metadata: deque[tuple[int, VideoMetadata]] = deque(maxlen=KEPT)
        self._last_taken: datetime | None = None
        self.counts = StreamCounts()

    def feed(self, data: bytes, oldest: datetime | None = None) -> list[ThermalImage]:
        """Process the next bytes of the stream, and return the images that they complete.

        Video is not decoded while its metadata are older than ``oldest``.
        """
        from tstrans.exceptions import DemuxError

        self.counts.size += len(data)
        found: list[ThermalImage] = []
        for start in range(0, len(data), PART_BYTES):
            try:
                self._demuxer.feed(data[start : start + PART_BYTES])
                for event in self._demuxer:
                    found += self._images_of(event, oldest)
            except DemuxError as error:  # continue with a new demuxer
                self.counts.lost += 1
                self.counts.picture_reason = str(error)
                self._demuxer = _demuxer()
        return found

    def end(self) -> list[ThermalImage]:
        """Return the images that remain at the end of the stream."""
        self._demuxer.flush()
        found: list[ThermalImage] = []
        for event in self._demuxer:
            found += self._images_of(event, None)
        return found + self._decoded(None, 0)

    def _images_of(self, event: "DemuxEvent", oldest: datetime | None) -> list[ThermalImage]:
        from tstrans.mpegts import DemuxEvent

        if isinstance(event, DemuxEvent.ProgramMap):
            self._use([info for program in event.programs for info in program.streams])
        elif isinstance(event, DemuxEvent.Metadata) and self._is_used(event.stream.program_number):
            self._add_metadata(event.pts.raw, event.payload)
        elif isinstance(event, DemuxEvent.Discontinuity):
            self._lose(event.stream.pid)
        elif isinstance(event, DemuxEvent.Video | DemuxEvent.UnknownSample):
            if self._video is None or event.stream.pid != self._video.pid:
                return []
            self.counts.pictures += 1
            if oldest is not None and self._metadata and self._metadata[-1][1].taken < oldest:
                self._skip(self._metadata[-1][1].taken)
                return []
            if self._is_cut:
                self._is_cut = False
                self.counts.bad_pictures += 1
                self.counts.picture_reason = "a part is missing"
                return []
            unit = event.raw if isinstance(event, DemuxEvent.Video) else event.payload
            return self._decoded(unit, event.pts.raw)
        return []

    def _use(self, streams: "list[StreamInfo]") -> None:
        """Use the first video of a program map; there is a new map whenever the streams change."""
        videos = [info for info in streams if _codec_of(info)]
        self.counts.videos = len(videos)
        if not videos or videos[0] == self._video:
            return
        self._video, self._decoder = videos[0], None
        self._metadata.clear()
        try:
            self._decoder = VideoDecoder(_codec_of(videos[0]))
        except VideoDecoderError as error:
            self.counts.picture_reason = str(error)

    def _is_used(self, program: int) -> bool:
        return self._video is not None and program == self._video.program_number

    def _lose(self, pid: int) -> None:
        """Record a gap, which is in the next access unit."""
        self.counts.lost += 1
        if self._video is not None and pid == self._video.pid:
            self._is_cut = True
            if self._decoder is not None:
                self._decoder.lose()

    def _skip(self, taken: datetime) -> None:
        """Skip an access unit; those after it cannot be decoded until the next key frame."""
        self.refuse(
            f"taken at {taken:%Y-%m-%d %H:%M:%S} UTC, older than "
            f"{self._settings.TABLE}.max_age_s allows"
        )
        if self._decoder is not None:
            self._decoder.lose()

    def _add_metadata(self, pts: int, payload: bytes) -> None:
        if not is_uas_metadata(payload):  # another set, for example security metadata
            return
        self.counts.metadata += 1
        try:
            self._metadata.append((pts, read_metadata(payload, self._settings)))
        except VideoMetadataError as error:
            self.counts.damaged_metadata += 1
            self.counts.metadata_reason = str(error)

    def _decoded(self, unit: bytes | None, pts: int) -> list[ThermalImage]:
        if self._decoder is None:
            self.counts.bad_pictures += unit is not None
            return []
        try:
            frames = self._decoder.decode(unit, pts)
        except VideoDecoderError as error:
            self.counts.bad_pictures += 1
            self.counts.picture_reason = str(error)
            return []
        return [image for frame in frames if (image := self._due(frame)) is not None]

    def _due(self, frame: "VideoFrame") -> ThermalImage | None:
        """Return the image of a picture if an image is due and the picture has metadata."""
        if frame.pts is None or not self._metadata:
            return None
        pts = frame.pts
        packets = list(self._metadata)
        number = min(range(len(packets)), key=lambda each: abs(packets[each][0] - pts))
        near, metadata = packets[number]
        if abs(near - pts) > NEAR_TICKS:
            return None
        if self._last_taken is not None and abs(metadata.taken - self._last_taken) < self._every:
            return None
        beside = packets[max(number - 1, 0) : number] + packets[number + 1 : number + 2]
        if beside and not any(is_continuous(metadata, each) for _, each in beside):
            self.refuse(
                f"metadata of {metadata.taken:%H:%M:%S} UTC differ from the metadata before and "
                "after them"
            )
            return None
        self._last_taken = metadata.taken
        try:
            image = image_of(frame, metadata, self._name, self._settings)
        except MissionServiceError as error:
            self.refuse(str(error))
            return None
        self.counts.images += 1
        return image

    def refuse(self, reason: str) -> None:
        """Count an image that is not used."""
        self.counts.refused += 1
        self.counts.refusal = reason


def image_of(
    frame: "VideoFrame", metadata: VideoMetadata, name: str, settings: ThermalVideoSection
) -> ThermalImage:
    """Return a picture of a video with the time and the position in its metadata.

    Raises MissionServiceError for a picture in colours, and for metadata without a position.
    """
    name = f"{name} {metadata.taken:%H:%M:%S}"
    if is_coloured(frame.to_ndarray(format="rgb24")):
        raise MissionServiceError(
            f"{name}: is a colour picture; set the camera's palette to grey levels (white hot)"
        )
    values, kind = frame.to_ndarray(format="gray").astype(np.float32), "levels"
    if settings.grey_level_range_c is not None:
        low_c, high_c = settings.grey_level_range_c
        values, kind = low_c + values * np.float32((high_c - low_c) / 255.0), "celsius"
    corners, pose = metadata.corners, metadata.pose
    if corners is not None and (settings.use_corner_points or pose is None):
        lat_deg, lon_deg = pose[:2] if pose else np.mean(corners.lat_lon_deg, axis=0).tolist()
        place = (lat_deg, lon_deg, 0.0, 0.0, 0.0, 0.0)
        return ThermalImage(name, values, kind, metadata.taken, *place, None, corners=corners)
    if pose is None:
        raise MissionServiceError(f"{name}: has no corner points and no pose: {metadata.no_pose}")
    if settings.use_corner_points:
        raise MissionServiceError(
            f"{name}: has no corner points; remove {settings.TABLE}.use_corner_points"
        )
    focal_px = None
    if settings.field_of_view_deg is None:
        focal_px = _focal_px(metadata, frame.width, frame.height, name)
    return ThermalImage(name, values, kind, metadata.taken, *pose, focal_px)


def _focal_px(metadata: VideoMetadata, width: int, height: int, name: str) -> float | None:
    """Return the focal length in (square) pixels, or None without a field of view.

    Raises MissionServiceError if the fields of view do not fit the picture.
    """
    field_deg, vertical_deg = metadata.field_of_view_deg, metadata.vertical_field_of_view_deg
    if field_deg is None or not MIN_FIELD_OF_VIEW_DEG <= field_deg <= MAX_FIELD_OF_VIEW_DEG:
        return None
    focal_px = focal_px_of(field_deg, width)
    expected_deg = 2.0 * math.degrees(math.atan(height / 2.0 / focal_px))
    if vertical_deg and abs(vertical_deg / expected_deg - 1.0) > MAX_FIELD_ERROR:
        raise MissionServiceError(
            f"{name}: tags 16 and 17, the fields of view, are {field_deg:.1f} and "
            f"{vertical_deg:.1f}°, which do not fit {width} x {height} square pixels; set "
            "estimate.thermal_video.field_of_view_deg"
        )
    return focal_px


def _codec_of(info: "StreamInfo") -> str:
    """Return FFmpeg's name of a video's codec, or an empty text for other streams."""
    name = getattr(info.codec, "value", "")
    return CODECS.get(name, STREAM_TYPES.get(info.stream_type, ""))


def _demuxer() -> "Demuxer":
    from tstrans.mpegts import Demuxer, DemuxerConfig

    return Demuxer(DemuxerConfig(unwrap_timestamps=True))
