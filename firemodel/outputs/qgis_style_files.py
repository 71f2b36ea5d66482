"""Create QGIS style files (.qml); QGIS applies a style when it opens the file of the same name."""

import math
from collections.abc import Mapping
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from firemodel.outputs.layer_legends import Layer

DOCTYPE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
VERSION = "3.22.0"  # QGIS version in the styles; newer versions can read them
OPACITY = "0.7"  # opacity of a layer, so that the map beneath remains visible
OUTLINE = "35,35,35,255"


def raster_qml(layer: Layer) -> str:
    """Return the style of a raster with one band: a colour and a label for each class.

    Args:
        layer: The layer, whose classes become the legend.

    Returns:
        The text of a .qml file (XML), with QGIS's renderer ``paletted`` for codes and
        ``singlebandpseudocolor`` for ranges.
    """
    root = Element("qgis", {"version": VERSION, "styleCategories": "Symbology"})
    pipe = SubElement(root, "pipe")
    kind = "paletted" if layer.categorical else "singlebandpseudocolor"
    attributes = {"type": kind, "band": "1", "opacity": OPACITY, "alphaBand": "-1"}
    renderer = SubElement(pipe, "rasterrenderer", attributes)
    if layer.categorical:
        entries = SubElement(renderer, "colorPalette")
        for value, colour, label in layer.classes:
            code = f"{value:g}"
            shown = {"value": code, "color": colour, "alpha": "255", "label": f"{code}: {label}"}
            SubElement(entries, "paletteEntry", shown)
    else:
        discrete = {"colorRampType": "DISCRETE", "classificationMode": "1", "clip": "0"}
        shader = SubElement(SubElement(renderer, "rastershader"), "colorrampshader", discrete)
        for upto, colour, label in layer.classes:
            bound = "inf" if math.isinf(upto) else repr(upto)
            shown = {"value": bound, "color": colour, "alpha": "255", "label": label}
            SubElement(shader, "item", shown)
    return _text(root)


def fronts_qml(layer: Layer) -> str:
    """Return the style of the burned areas of ``front_files``, coloured by ``time_s``.

    The areas overlap. QGIS draws the latest area first, so that the visible part of each area is
    the ground that burned after the previous front.

    Args:
        layer: A layer of arrival times in seconds.

    Returns:
        The text of a .qml file (XML), with QGIS's renderer ``graduatedSymbol``.
    """
    root = Element("qgis", {"version": VERSION, "styleCategories": "Symbology"})
    attributes = {"type": "graduatedSymbol", "attr": "time_s", "graduatedMethod": "GraduatedColor"}
    attributes |= {"symbollevels": "0", "enableorderby": "1"}
    renderer = SubElement(root, "renderer-v2", attributes)
    spans, symbols = SubElement(renderer, "ranges"), SubElement(renderer, "symbols")
    lower = -1.0
    for number, each in enumerate(layer.classes):
        name = str(number)
        shown = {"symbol": name, "label": each.label, "render": "true"}
        SubElement(spans, "range", {"lower": repr(lower), "upper": repr(each.upto), **shown})
        fill = {
            "color": "{},{},{},255".format(*each.rgb),
            "style": "solid",
            "outline_color": OUTLINE,
        }
        fill |= {"outline_style": "solid", "outline_width": "0.3", "outline_width_unit": "MM"}
        _add_symbol(symbols, name, fill)
        lower = each.upto
    order = SubElement(renderer, "orderby")
    SubElement(order, "orderByClause", {"asc": "0", "nullsFirst": "0"}).text = '"time_s"'
    SubElement(root, "layerOpacity").text = OPACITY
    return _text(root)


def _add_symbol(symbols: Element, name: str, fill: Mapping[str, str]) -> None:
    symbol = SubElement(symbols, "symbol", {"type": "fill", "name": name, "alpha": "1"})
    layer = SubElement(symbol, "layer", {"class": "SimpleFill", "enabled": "1", "pass": "0"})
    options = SubElement(layer, "Option", {"type": "Map"})
    for key, value in fill.items():
        SubElement(options, "Option", {"type": "QString", "name": key, "value": value})


def _text(root: Element) -> str:
    indent(root)
    return DOCTYPE + tostring(root, encoding="unicode") + "\n"
