"""Find the attributes of mapped fires by the field names that several agencies use."""

from collections.abc import Mapping, Sequence
from typing import Any

# Shapefiles truncate names to ten characters; WFIGS views add a prefix.
CUT = 10
PREFIXES = ("", "poly_", "attr_")


def attribute(attributes: Mapping[str, Any], names: Sequence[str]) -> Any:
    """Return the first attribute with one of these names, or None; see ``CUT`` and ``PREFIXES``."""
    lower = {key.lower(): value for key, value in attributes.items()}
    for name in names:
        for prefix in PREFIXES:
            for key in (prefix + name, (prefix + name)[:CUT]):
                # poly_Featu is the truncated name of three attributes.
                if key.lower() == "poly_featu" and name != "FeatureCategory":
                    continue
                if lower.get(key.lower()) not in (None, ""):
                    return lower[key.lower()]
    return None
