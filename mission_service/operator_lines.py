"""Describes operators' notes and changes to the fire or to settings in one line each. Pure."""

from mission_service import events

SHAPES = {"point": "point", "line": "line", "polygon": "area"}


def operator_line(event: events.AnyEvent) -> str:
    """Return what an operator changed or noted, with the author; "" for all other events."""
    if not isinstance(event, events.OperatorEvent):
        return ""
    by = event.by or "an operator"
    match event:
        case events.Corrected():
            return f"{by} draws a {event.state} {SHAPES[event.shape]}{_when(event)}"
        case events.Erased():
            place = f"{event.lat_deg:.5f}, {event.lon_deg:.5f}"
            return f"{by} erases corrections within {event.radius_m:.0f} m of {place}"
        case events.Undone():
            return f"{by} undoes the last correction"
        case events.Redone():
            return f"{by} restores the last undone correction"
        case events.WindSet():
            return f"{by} sets the wind: {event.speed_m_s:.1f} m/s from {event.from_deg:.0f}°"
        case events.NoteAdded():
            place = f"{event.lat_deg:.5f}, {event.lon_deg:.5f}"
            photo = f" (photo {event.photo})" if event.photo else ""
            return f"{by} notes at {place}: {event.text}{photo}"
        case events.AlarmAcknowledged():
            return f"{by} acknowledges the alarm {event.alarm}"
        case events.SettingsChanged():
            values = [f"{name} = {value:g}" for name, value in event.given.items()]
            return f"{by} changes settings: {', '.join(values)}"
        case _:
            return ""


def _when(event: events.Corrected) -> str:
    """Return the time of the drawn state, if it differs from the time of the correction."""
    minutes = round((event.marked_at_us - event.at_us) / 60e6)
    if minutes == 0:
        return ""
    return f", valid {minutes} min later" if minutes > 0 else f", valid {-minutes} min earlier"
