"""Prepare the photos of notes as pictures for a KMZ: upright, small, and without EXIF data."""

import hashlib
import io
import struct
from pathlib import Path

from mission_service.uploaded_photos import photo_path

MAX_SIDE_PIXELS = 1600
QUALITY = 85


def picture_of(run: Path, photo: str) -> bytes | None:
    """Return the stored photo with this name as JPEG; None if it is missing or was modified.

    The name of a photo contains the SHA-256 of its bytes. Many viewers of KMZ ignore the
    orientation in EXIF data and do not show WebP.
    """
    from PIL import Image, ImageOps

    path = photo_path(run, photo)
    if path is None:
        return None
    data = path.read_bytes()
    if hashlib.sha256(data).hexdigest() != path.stem:
        return None
    with Image.open(io.BytesIO(data)) as stored:
        stored.draft("RGB", (MAX_SIDE_PIXELS, MAX_SIDE_PIXELS))
        stored.thumbnail((MAX_SIDE_PIXELS, MAX_SIDE_PIXELS))
        try:
            turned = ImageOps.exif_transpose(stored)
        except (SyntaxError, ValueError, OSError, struct.error):  # unreadable EXIF data
            turned = stored
        picture = turned.convert("RGB")
        made = io.BytesIO()
        picture.save(made, "JPEG", quality=QUALITY)
    return made.getvalue()
