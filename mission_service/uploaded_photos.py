"""Checks uploaded photos of places, and stores them in a folder beside the journal.

The journal contains only a photo's name: the SHA-256 of its bytes, and its format. Positions in
a photo's EXIF data are not used; the note states the place.
"""

import hashlib
import io
import re
from pathlib import Path

from mission_service.errors import MissionServiceError

FORMATS = {"JPEG": "jpg", "PNG": "png", "WEBP": "webp"}
MEDIA_TYPES = {"jpg": "image/jpeg", "png": "image/png", "webp": "image/webp"}
FOLDER = "photos"
MAX_PIXELS = 64_000_000
MAX_PHOTOS_BYTES = 2_000_000_000  # for all photos of a run
NAMED = re.compile(r"[0-9a-f]{64}\.(jpg|png|webp)")


class PhotoError(MissionServiceError):
    """A file cannot be used as a photo; the message states the reason."""


def photo_name(data: bytes) -> str:
    """Return the name of a photo: SHA-256 and format. Raises PhotoError for an unusable file."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(data), formats=tuple(FORMATS)) as image:
            if image.width * image.height > MAX_PIXELS:
                size = f"{image.width} x {image.height} pixels"
                raise PhotoError(f"the photo has {size}; at most {MAX_PIXELS:,} are permitted")
            extension = FORMATS[image.format or ""]
            image.draft("RGB", (64, 64))  # decodes a small version of a JPEG
            image.load()
    except PhotoError:
        raise
    except UnidentifiedImageError:
        raise PhotoError("the file is not a photo; send JPEG, PNG or WebP") from None
    # Pillow raises many kinds of exceptions for damaged files.
    except Exception as error:
        words = " ".join(str(error).split())[:100] or type(error).__name__
        raise PhotoError(f"the photo is corrupt: {words}; take or export it again") from None
    return f"{hashlib.sha256(data).hexdigest()}.{extension}"


def store_photo(run: Path, data: bytes) -> str:
    """Store a photo in the folder of a run; return its name. Raises PhotoError, OSError."""
    name = photo_name(data)
    folder = run / FOLDER
    path = folder / name
    if path.exists():
        return name
    folder.mkdir(exist_ok=True)
    stored_bytes = sum(each.stat().st_size for each in folder.iterdir())
    if stored_bytes + len(data) > MAX_PHOTOS_BYTES:
        gigabytes = f"{stored_bytes / 1e9:.1f} of {MAX_PHOTOS_BYTES / 1e9:g} GB"
        raise PhotoError(f"{folder}: the photos of the run already use {gigabytes}")
    part = folder / f"{name}.part"
    part.write_bytes(data)
    part.replace(path)
    return name


def photo_path(run: Path, name: str) -> Path | None:
    """Return the path of a stored photo, or None if there is none with this name."""
    path = run / FOLDER / name
    return path if NAMED.fullmatch(name) and path.is_file() else None
