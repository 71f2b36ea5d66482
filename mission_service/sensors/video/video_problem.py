"""Describe why a video is not used, from the counts of the last seconds. Pure."""

from mission_service.sensors.one_line import one_line
from mission_service.sensors.video.video_stream import StreamCounts


def video_problem(counts: StreamCounts, source: str, notice: str, seconds: float) -> str:
    """Return the first problem of a video in one line, or an empty text.

    Args:
        counts: The counts of the last ``seconds``.
        source: The address or the file.
        notice: The source's text about its input, or an empty text.
        seconds: The period of the counts.
    """
    also = f" ({notice})" if notice else ""
    problem = _of_stream(counts, seconds) or _of_parts(counts)
    if not problem:
        return f"{source}: {notice}" if notice else ""
    return one_line(f"{source}: {problem}{also}")


def _of_stream(counts: StreamCounts, seconds: float) -> str:
    """Return why no image can be made at all."""
    if counts.size == 0:
        return f"nothing has arrived for {seconds:.0f} s; check the sender"
    if counts.videos == 0:
        return "no video of a known codec; send H.264 in an MPEG transport stream"
    if counts.metadata == 0:
        return "no metadata in the stream; enable MISB ST 0601 (KLV) in the encoder"
    if counts.pictures == 0:
        return "metadata arrive, but no pictures"
    return ""


def _of_parts(counts: StreamCounts) -> str:
    """Return which parts of the stream are not used."""
    if counts.damaged_metadata:
        return (
            f"{counts.damaged_metadata} of {counts.metadata} metadata packets are not used: "
            f"{counts.metadata_reason}"
        )
    if counts.bad_pictures:
        return (
            f"{counts.bad_pictures} of {counts.pictures} pictures are not used: "
            f"{counts.picture_reason}"
        )
    if counts.refused:
        return f"{counts.refused} images are not used: {counts.refusal}"
    if counts.lost and not counts.images:
        return f"{counts.lost} gaps in the stream, and no key frame after them"
    if not counts.images:
        return "no picture has metadata within 0.1 s of it"
    return ""
