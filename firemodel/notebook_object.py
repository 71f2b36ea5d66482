"""Define the base class of the objects that notebooks show as pictures."""

from importlib import import_module
from typing import Any


class NotebookObject:
    """An object that a notebook shows as a picture and as a table of facts.

    ``outputs.notebook_views`` draws the picture. That module is imported on first use, because it
    imports the modules of these objects.
    """

    def _repr_png_(self) -> bytes:
        picture: bytes = _views().png_of(self)
        return picture

    def _repr_html_(self) -> str:
        text: str = _views().html_of(self)
        return text


def _views() -> Any:
    return import_module("firemodel.outputs.notebook_views")
