"""Draw the briefing map of an incident on one page: fire, forecast, heat, grids, legend, facts."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from shapely import get_coordinates, get_parts

from firemodel.arrays import Floats
from firemodel.landscape.landscape import Landscape, crs_label
from firemodel.outputs.arrival_map import draw_ground
from firemodel.outputs.graticule import Frame, draw_graticule, draw_north, km_of
from mission_service.products.grid_reference import draw_utm_grid, grid_square
from mission_service.products.incident import LEVELS, NOTE, Incident, hectares

MM = 1.0 / 25.4  # in inches
MARGIN_IN, TITLE_IN, FOOT_IN, PANEL_IN = 0.35, 0.6, 0.42, 2.5
LABELS_IN = 0.28  # space around the map frame for the coordinates
SCALES = (
    *(2_000, 4_000, 6_000, 8_000, 10_000, 12_000, 15_840, 20_000, 24_000, 31_680, 40_000, 50_000),
    *(63_360, 80_000, 100_000, 126_720, 200_000, 250_000, 500_000, 1_000_000, 2_000_000),
)  # fmt: skip
MAX_TITLE = 60  # characters that fit on the page
FEW_ACRES = 100.0  # smaller areas are written with one decimal
BAR_LENGTHS = (0.02, 0.05, 0.1, 0.2, 0.4, 1, 2, 4, 10, 20, 40, 100)  # km or miles
AROUND = 1.12  # the map is larger than the fire and its forecast by this factor
MIN_KM = 1.0
PERIMETER, EARLIER, AHEAD, LIKELY = "#c00000", "#7f1d1d", "#6a1b9a", "#0b57a4"
HOT, DROP, OUTSIDE = "#e00000", "#111111", "#ececec"
BAR_IN = 2.2  # maximum length of a scale bar


class Page(NamedTuple):
    """A paper size in landscape orientation, in inches."""

    name: str
    title: str
    width_in: float
    height_in: float


LETTER, A4 = Page("letter", "Letter", 11.0, 8.5), Page("a4", "A4", 297.0 * MM, 210.0 * MM)


class MapPage(NamedTuple):
    """A drawn page; ``frame`` is the extent of the axes in km from the landscape's corner."""

    figure: Figure
    axes: Any
    frame: Frame


def draw_page(incident: Incident, page: Page) -> MapPage:
    """Draw the map on a page."""
    figure = Figure(figsize=(page.width_in, page.height_in))
    FigureCanvasAgg(figure)
    land = incident.landscape
    left, bottom = MARGIN_IN + LABELS_IN, MARGIN_IN + FOOT_IN + LABELS_IN
    width = page.width_in - left - LABELS_IN - PANEL_IN - MARGIN_IN
    height = page.height_in - bottom - LABELS_IN - TITLE_IN - MARGIN_IN
    scale, frame = frame_of(incident, width, height)
    axes = figure.add_axes(
        (
            left / page.width_in,
            bottom / page.height_in,
            width / page.width_in,
            height / page.height_in,
        )
    )
    fuels = draw_ground(axes, land, frame)
    axes.set_facecolor(OUTSIDE)
    axes.set_aspect("auto")
    handles = _draw_fire(axes, incident)
    handles += _draw_heat(axes, incident) + _draw_drops(axes, incident)
    draw_graticule(axes, land, frame)
    axes.tick_params(labelsize=6.5, length=2, pad=2)
    zone, step_km = draw_utm_grid(axes, land, frame)
    draw_north(axes, land)
    axes.set(xlim=frame[:2], ylim=frame[2:])
    _write_title(figure, page, incident)
    grid = f"Blue grid: UTM zone {zone.number}{'N' if zone.is_north else 'S'}, {step_km:g} km"
    _write_panel(figure, page, incident, handles, fuels)
    _write_foot(figure, page, incident, f"Scale 1:{scale:,} on {page.title} paper", grid)
    _draw_scale_bars(figure, page, scale)
    return MapPage(figure, axes, frame)


def frame_of(incident: Incident, width_in: float, height_in: float) -> tuple[int, Frame]:
    """Return the round map scale at which the fire and its forecast fit, and the map's frame."""
    points = _km(incident.landscape, _points_of(incident))
    low, high = points.min(axis=0), points.max(axis=0)
    span_km = np.maximum(AROUND * (high - low), MIN_KM)
    km_per_scale = np.array([width_in, height_in]) * 0.0254 / 1e3
    scale = next((each for each in SCALES if (km_per_scale * each >= span_km).all()), SCALES[-1])
    (east, north), (half_x, half_y) = (low + high) / 2.0, km_per_scale * scale / 2.0
    return scale, (east - half_x, east + half_x, north - half_y, north + half_y)


def _points_of(incident: Incident) -> Floats:
    """Return the coordinates (n, 2; m) of everything that the map must show."""
    land = incident.landscape
    shapes = [incident.area(incident.at_s), *incident.heat.intense, *incident.heat.isolated]
    if incident.probability is not None:
        shapes.append(incident.likely_area(LEVELS[0]))
    found = [get_coordinates(shape) for shape in shapes]
    drops = [drop for each in incident.record.vehicles.values() for drop in each.drops]
    found.append(land.xy_of_places([(drop.lat_deg, drop.lon_deg) for drop in drops]))
    points = np.concatenate(found)
    if len(points):
        return points
    rows, cols = land.shape
    return np.stack(land.xy_of(np.array([0, rows - 1]), np.array([0, cols - 1])), axis=1)


def _km(land: Landscape, xy_m: Floats) -> Floats:
    """Convert projected coordinates (n, 2; m) to km from the landscape's south-west corner."""
    found: Floats = (xy_m - [land.west_m, land.south_m]) / 1e3
    return found


def _add_area(axes: Any, land: Landscape, area: Any, **style: Any) -> None:
    """Draw the polygons of an area with their holes."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    for polygon in get_parts(area):
        rings = [
            _km(land, np.asarray(ring.coords)) for ring in (polygon.exterior, *polygon.interiors)
        ]
        outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
        axes.add_patch(PathPatch(outline, **style))


def _draw_fire(axes: Any, incident: Incident) -> list[Any]:
    """Draw the perimeter, earlier fronts and the forecast; return the entries of the legend."""
    land, now = incident.landscape, incident.area(incident.at_s)
    handles: list[Any] = []

    def draw(areas: Sequence[Any], label: str, **style: Any) -> None:
        drawn = [area for area in areas if not area.is_empty]
        for area in drawn:
            _add_area(axes, land, area, fill=False, **style)
        if drawn:
            line = {key: style[key] for key in ("linewidth", "linestyle") if key in style}
            handles.append(Line2D([], [], color=style["edgecolor"], label=label, **line))

    _add_area(axes, land, now, facecolor="#ff6d3a", alpha=0.28, edgecolor="none")
    draw([now], "Perimeter now", edgecolor=PERIMETER, linewidth=2.0)
    earlier = [incident.area(at_s) for at_s in incident.past_times_s()[:-1]]
    draw(earlier, "Perimeter at earlier hours", edgecolor=EARLIER, linewidth=0.5)
    ahead = {at_s: incident.area(at_s) for at_s in incident.forecast_times_s()}
    label = "Hourly forecast (median)"
    draw(list(ahead.values()), label, edgecolor=AHEAD, linewidth=1.1, linestyle="--")
    if incident.probability is not None:
        end = f"{incident.when(_end_s(incident)):%H:%M}"
        for level, width in zip(LEVELS, (0.8, 1.2, 1.8), strict=True):
            label = f"{100 * level:.0f} % probability of fire by {end}"
            style: dict[str, Any] = {"edgecolor": LIKELY, "linewidth": width, "linestyle": ":"}
            draw([incident.likely_area(level)], label, **style)
    for at_s, area in ahead.items():
        if not area.is_empty:
            middle = _km(land, np.array((area if now.is_empty else now).centroid.coords))[0]
            points = _km(land, get_coordinates(area))
            _label_front(axes, points, middle, f"{incident.when(at_s):%H:%M}")
    return handles


def _label_front(axes: Any, points: Floats, middle: Floats, text: str) -> None:
    """Write a time at a forecast front's point (n, 2; km) farthest from the fire's centre."""
    from matplotlib.patheffects import withStroke

    place = points[np.argmax(np.hypot(*(points - middle).T))]
    label = axes.annotate(
        text, place, fontsize=7, fontweight="bold", color=AHEAD, ha="center", va="center",
        annotation_clip=True,
    )  # fmt: skip
    label.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _draw_heat(axes: Any, incident: Incident) -> list[Any]:
    """Draw heat with the symbols of infrared interpreters; return the entries of the legend."""
    land, heat = incident.landscape, incident.heat
    handles: list[Any] = []
    for areas, hatch, label in (
        (heat.intense, "\\\\\\\\\\\\", "Intense heat"),
        (heat.scattered, "...", "Scattered heat"),
    ):
        style: dict[str, Any] = {"facecolor": "none", "edgecolor": HOT, "linewidth": 0.6}
        for area in areas:
            _add_area(axes, land, area, hatch=hatch, **style)
        if areas:
            handles.append(Patch(hatch=hatch, label=label, **style))
    if heat.isolated:
        x, y = _km(land, np.array([point.coords[0] for point in heat.isolated])).T
        style = {"color": HOT, "marker": "o", "markersize": 3.0, "linestyle": ""}
        axes.plot(x, y, **style)
        handles.append(Line2D([], [], label="Isolated heat source", **style))
    return handles


def _draw_drops(axes: Any, incident: Incident) -> list[Any]:
    drops = [drop for each in incident.record.vehicles.values() for drop in each.drops]
    if not drops:
        return []
    x, y = km_of(incident.landscape, *np.array([(each.lat_deg, each.lon_deg) for each in drops]).T)
    style: dict[str, Any] = {"color": DROP, "marker": "x", "markersize": 3.5, "linestyle": ""}
    axes.plot(x, y, **style)
    return [Line2D([], [], label="Drop", **style)]


def _end_s(incident: Incident) -> float:
    return incident.at_s + incident.forecast_s


def _write_title(figure: Figure, page: Page, incident: Incident) -> None:
    top = 1.0 - MARGIN_IN / page.height_in
    left = MARGIN_IN / page.width_in
    name = incident.name
    if len(name) > MAX_TITLE:
        name = f"{name[: MAX_TITLE - 1]}…"
    kind = "Prescribed fire" if incident.prescribed else "Fire perimeter"
    if incident.area(incident.at_s).is_empty:
        kind = "No fire in the estimate"
    end = incident.in_words(_end_s(incident))
    more = f" and forecast to {end}" if incident.forecast_s else ""
    figure.text(left, top, name, fontsize=18, fontweight="bold", va="top", parse_math=False)
    line = f"{kind} at {incident.in_words(incident.at_s)}{more}"
    figure.text(left, top - 0.33 / page.height_in, line, fontsize=9.5, va="top")


def _write_panel(
    figure: Figure,
    page: Page,
    incident: Incident,
    handles: Sequence[Any],
    fuels: Sequence[tuple[str, str]],
) -> None:
    """Write area, source and legend to the right of the map."""
    left = 1.0 - (MARGIN_IN + PANEL_IN - 0.2) / page.width_in
    top = 1.0 - (MARGIN_IN + TITLE_IN + LABELS_IN) / page.height_in
    acres = incident.acres
    decimals = int(acres < FEW_ACRES)
    figure.text(left, top, f"{acres:,.{decimals}f} acres", fontsize=17, fontweight="bold", va="top")
    lines = [f"{hectares(acres):,.{decimals}f} ha, geodesic (WGS84)", *_facts(incident)]
    body = figure.text(
        left, top - 0.33 / page.height_in, "\n".join(lines), fontsize=7.5, va="top",
        linespacing=1.35, parse_math=False,
    )  # fmt: skip
    height_in = body.get_window_extent().height / figure.dpi
    legend_top = top - (0.33 + height_in + 0.12) / page.height_in
    swatches = [Patch(facecolor=colour, edgecolor="0.4", linewidth=0.4, label=name)
                for colour, name in fuels]  # fmt: skip
    heading = Patch(alpha=0.0, label="Fuel")
    legend = figure.legend(
        handles=[*handles, heading, *swatches], loc="upper left", bbox_to_anchor=(left, legend_top),
        fontsize=7, frameon=False, borderaxespad=0.0, borderpad=0.0, handlelength=2.2,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_fontweight("bold" if text.get_text() == heading.get_label() else "normal")


def _facts(incident: Incident) -> list[str]:
    """Return the lines about perimeter, growth, images and source."""
    area = incident.area(incident.at_s)
    lines = [f"Perimeter {area.length / 1e3:,.1f} km ({area.length / 1609.344:,.1f} mi)"]
    images = incident.images
    if images.first_s is None or images.last_s is None:
        lines.append("No images: fire model and reports only")
    else:
        lines.append(f"{images.total:,} images until {incident.when(images.last_s):%Y-%m-%d %H:%M}")
    if incident.probability is not None:
        low, high = (incident.likely_acres(level) for level in (0.9, 0.1))
        lines.append(f"By {incident.when(_end_s(incident)):%H:%M}: {low:,.0f} to {high:,.0f} acres")
        lines.append("(90 % and 10 % probability)")
        if _is_cut(incident):
            lines.append("The forecast ends at the edge of the data.")
    return lines


def _is_cut(incident: Incident) -> bool:
    """Return whether fire may leave the landscape within the forecast."""
    assert incident.probability is not None
    edges = (incident.probability[place] for place in (0, -1, (..., 0), (..., -1)))
    return any(bool((edge >= LEVELS[0]).any()) for edge in edges)


def _draw_scale_bars(figure: Figure, page: Page, scale: int) -> None:
    """Draw scale bars in km and miles below the panel."""
    left, step_in = page.width_in - MARGIN_IN - PANEL_IN + 0.2, 0.3
    for number, (unit, metres) in enumerate((("km", 1000.0), ("mi", 1609.344))):
        length = max(each for each in BAR_LENGTHS if each * metres / scale / 0.0254 <= BAR_IN)
        bar_in = length * metres / scale / 0.0254
        y_in = MARGIN_IN + FOOT_IN + 0.1 + number * step_in
        axes = figure.add_axes(
            (left / page.width_in, y_in / page.height_in, bar_in / page.width_in,
             0.05 / page.height_in)
        )  # fmt: skip
        axes.set(xlim=(0.0, length), ylim=(0.0, 1.0), yticks=[], xticks=[0.0, length / 2, length])
        axes.axvspan(0.0, length / 2, color="black")
        axes.tick_params(labelsize=6.5, length=0, pad=1)
        axes.set_xticklabels(["0", f"{length / 2:g}", f"{length:g} {unit}"])


def _write_foot(figure: Figure, page: Page, incident: Incident, scale: str, grid: str) -> None:
    land = incident.landscape
    lat, lon = land.centre_lat_lon
    square = grid_square(lat, lon)
    usng = f", USNG/MGRS square {square}" if square else ""
    lines = (
        f"{scale}. Grey: no data. Projection {crs_label(land.crs)}. {grid}{usng}. Black "
        "grid: latitude and longitude, WGS84. Arrow: true north.",
        f"Source: {NOTE} Background: hillshade and fuel models of the scenario.",
    )
    figure.text(
        MARGIN_IN / page.width_in, MARGIN_IN / page.height_in, "\n".join(lines), fontsize=6.5,
        va="bottom", linespacing=1.4, parse_math=False,
    )  # fmt: skip
