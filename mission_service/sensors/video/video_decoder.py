"""Decode the pictures of a video stream with PyAV, and discard damaged ones."""

from typing import TYPE_CHECKING, Any

from mission_service.errors import MissionServiceError

if TYPE_CHECKING:
    from av import VideoFrame

CODECS = {
    "h264": "h264",
    "h265": "hevc",
    "h266": "vvc",
    "av1": "av1",
}  # names of tstrans and FFmpeg
STREAM_TYPES = {0x01: "mpeg1video", 0x02: "mpeg2video", 0x10: "mpeg4"}  # not named by tstrans
OPTIONS = {"err_detect": "explode", "max_pixels": "25000000"}


class VideoDecoderError(MissionServiceError):
    """A video or a picture that cannot be decoded; the message states the reason."""


class VideoDecoder:
    """A decoder that returns a picture only if all pictures on which it depends have arrived.

    After a loss or a damaged picture, no picture is returned until the next key frame, because
    FFmpeg would fill the missing parts from other pictures.
    """

    def __init__(self, codec: str) -> None:
        """Raise VideoDecoderError for a codec that FFmpeg does not decode."""
        import av

        try:
            self._context: Any = av.CodecContext.create(codec, "r")
        except (av.error.FFmpegError, av.codec.codec.UnknownCodecError):
            raise VideoDecoderError(f"the codec {codec} cannot be decoded; use H.264") from None
        self._context.thread_count = 1
        self._context.options = OPTIONS
        self._waits_for_key_frame = True

    def lose(self) -> None:
        """Record that a part of the video is missing."""
        self._waits_for_key_frame = True

    def decode(self, unit: bytes | None, pts: int) -> "list[VideoFrame]":
        """Return the pictures that an access unit completes; with None, all remaining pictures.

        Raises VideoDecoderError for a damaged unit.
        """
        import av

        packet = None
        if unit is not None:
            packet = av.Packet(unit)
            packet.pts = pts
        try:
            frames = self._context.decode(packet)
        except av.error.FFmpegError as error:
            if self._waits_for_key_frame:
                raise VideoDecoderError("no key frame after a gap or a damaged picture") from None
            self.lose()
            raise VideoDecoderError(f"a picture is damaged: {error.strerror}") from None
        return [frame for frame in frames if self._is_whole(frame)]

    def _is_whole(self, frame: "VideoFrame") -> bool:
        if frame.is_corrupt:
            self.lose()
        elif frame.key_frame:
            self._waits_for_key_frame = False
        return not self._waits_for_key_frame
