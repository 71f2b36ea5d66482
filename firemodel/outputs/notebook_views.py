"""Show landscapes and fires in notebooks: a map with a legend (PNG), and a table of facts (HTML).

Notebooks call the methods of ``NotebookObject``, the base of ``Landscape`` and ``Fire``, which call
these functions. A front is a shapely geometry, which draws itself.
"""

import base64
import html
import io

import numpy as np

from firemodel.landscape.landscape import Landscape, crs_label
from firemodel.outputs.arrival_map import (
    area_in_words,
    frame_around,
    save_map,
    set_title,
    start_map,
    status_line,
)
from firemodel.outputs.layer_legends import arrival_layer_of
from firemodel.spread.fire_scheme import Fire

DPI = 72  # of the pictures: 864 x 662 pixels
MAX_FUELS = 5  # number of fuels listed


def png_of(thing: Landscape | Fire) -> bytes:
    """Return a map of a landscape, or of the arrival times of a fire, as a PNG."""
    if isinstance(thing, Landscape):
        arrival_s = np.full(thing.shape, np.inf)
        figure, axes = start_map(thing, arrival_s, frame_around(thing, arrival_s))
        set_title(axes, "Landscape", _size(thing))
    else:
        arrival_s = thing.burned_arrival_s()
        frame = frame_around(thing.landscape, arrival_s)
        layer = arrival_layer_of(thing, None)
        figure, axes = start_map(thing.landscape, arrival_s, frame, isochrones=True, layer=layer)
        set_title(axes, "Fire", status_line(thing))
    figure.set_dpi(DPI)
    made = io.BytesIO()
    save_map(figure, made)
    return made.getvalue()


def html_of(thing: Landscape | Fire) -> str:
    """Return a table of facts and the map of a landscape or a fire as HTML."""
    facts = landscape_facts(thing) if isinstance(thing, Landscape) else fire_facts(thing)
    rows = "".join(
        f'<tr><th style="text-align:left">{html.escape(name)}</th>'
        f'<td style="text-align:left">{html.escape(value)}</td></tr>'
        for name, value in facts.items()
    )
    picture = base64.b64encode(png_of(thing)).decode()
    return (
        f"<table>{rows}</table>"
        f'<img style="max-width:100%" alt="map" src="data:image/png;base64,{picture}">'
    )


def landscape_facts(land: Landscape) -> dict[str, str]:
    """Return the facts about a landscape in words, by name."""
    codes, counts = np.unique(land.fuel_model, return_counts=True)
    most = np.argsort(-counts, kind="stable")[:MAX_FUELS]
    shares = [f"{codes[n]} ({100 * counts[n] / counts.sum():.0f} %)" for n in most]
    rest = "" if len(codes) <= MAX_FUELS else f" and {len(codes) - MAX_FUELS} others"
    lat_deg, lon_deg = land.centre_lat_lon
    z = land.elevation_m
    facts = {
        "grid": _size(land),
        "projection": crs_label(land.crs),
        "centre": f"{lat_deg:.5f}, {lon_deg:.5f} (WGS 84)",
        "elevation": "none" if z is None else f"{z.min():.0f} to {z.max():.0f} m",
        "steepest slope": f"{np.rad2deg(np.arctan(land.slope_tan.max())):.0f}°",
        "fuel models": ", ".join(shares) + rest,
    }
    if land.canopy_cover is not None:
        facts["canopy cover"] = f"mean {100 * float(land.canopy_cover.mean()):.0f} %"
    return facts


def fire_facts(fire: Fire) -> dict[str, str]:
    """Return the facts about a fire in words, by name."""
    front = fire.front(fire.time_s)
    parts = len(getattr(front, "geoms", (front,)))
    return {
        "time": f"{fire.time_s:.0f} s ({fire.time_s / 3600.0:.2f} h)",
        "burned area": area_in_words(front.area),
        "perimeter": f"{front.length / 1e3:.2f} km in {parts} part{'' if parts == 1 else 's'}",
        "spread scheme": type(fire).__name__,
    }


def _size(land: Landscape) -> str:
    rows, cols = land.shape
    side_km = land.cell_size_m / 1e3
    return (
        f"{rows} x {cols} cells of {land.cell_size_m:g} m "
        f"({rows * side_km:.2f} x {cols * side_km:.2f} km)"
    )
