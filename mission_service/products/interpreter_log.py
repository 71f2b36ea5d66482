"""Write the interpreter's log: facts about the infrared images and their interpretation."""

from mission_service.products.incident import HOUR_S, Incident, hectares

WIDTH = 26


def log_text(incident: Incident, files: list[str]) -> str:
    """Return the log as text, with the fields of an infrared interpreter's daily log."""
    rows = [
        ("Incident name", incident.name),
        ("State at", incident.in_words(incident.at_s)),
        ("Interpreted by", "mission-service, automatically; not reviewed by a person"),
        (
            "Interpreted size",
            f"{incident.acres:,.1f} acres ({hectares(incident.acres):,.1f} ha), geodesic",
        ),
        *_growth(incident),
        *_images(incident),
        *_sources(incident),
        *_heat(incident),
        *_forecast(incident),
        ("Drops", f"{sum(len(each.drops) for each in incident.record.vehicles.values())}"),
        ("Coordinate system", "WGS84 (EPSG:4326); rasters in the projection of the landscape"),
        ("Files", ", ".join(files)),
    ]
    lines = ["INFRARED INTERPRETER'S LOG", ""]
    lines += [f"{name + ':':<{WIDTH}}{value}" for name, value in rows]
    lines += ["", "Corrections, settings and announcements:"]
    lines += [
        f"{incident.when(line.at_s):%Y-%m-%d %H:%M:%S %Z}  {line.text}" for line in incident.log
    ]
    return "\n".join([*lines, *([] if incident.log else ["none"]), ""])


def _growth(incident: Incident) -> list[tuple[str, str]]:
    """Return the growth in the last hour and in the last 24 hours, if the fire is older."""
    begun_s = float(incident.arrival.arrival_s.min())
    found = []
    for hours in (1, 24):
        before_s = incident.at_s - hours * HOUR_S
        if before_s >= begun_s:
            # Both areas are planar; their ratio is that of the geodesic areas.
            now_m2 = incident.area(incident.at_s).area
            share = 1.0 - incident.area(before_s).area / now_m2
            found.append((f"Growth in {hours} h", f"{incident.acres * share:,.1f} acres"))
    return found


def _images(incident: Incident) -> list[tuple[str, str]]:
    images = incident.images
    if images.first_s is None or images.last_s is None:
        return [("Images", "none; the perimeter is from the fire model and reports")]
    first, last = (incident.in_words(at_s) for at_s in (images.first_s, images.last_s))
    return [("Images", f"{images.total:,}"), ("First image", first), ("Last image", last)]


def _sources(incident: Incident) -> list[tuple[str, str]]:
    found = incident.record.sources.contributions
    return [
        ("Source", f"{name} ({each.kind}): {each.observations:,} observations, "
                   f"{each.not_used:,} not used")
        for name, each in sorted(found.items())
    ]  # fmt: skip


def _heat(incident: Incident) -> list[tuple[str, str]]:
    heat = incident.heat
    areas_ha = [sum(area.area for area in areas) / 1e4 for areas in (heat.intense, heat.scattered)]
    return [
        ("Intense heat", f"{len(heat.intense)} areas, {areas_ha[0]:,.1f} ha"),
        ("Scattered heat", f"{len(heat.scattered)} areas, {areas_ha[1]:,.1f} ha"),
        ("Isolated heat sources", str(len(heat.isolated))),
    ]


def _forecast(incident: Incident) -> list[tuple[str, str]]:
    if incident.probability is None:
        return []
    end = incident.in_words(incident.at_s + incident.forecast_s)
    areas = [incident.likely_acres(level) for level in (0.9, 0.5, 0.1)]
    words = ", ".join(
        f"{level} %: {acres:,.0f} acres" for level, acres in zip((90, 50, 10), areas, strict=True)
    )
    return [("Forecast to", end), ("Burned with probability", words)]
