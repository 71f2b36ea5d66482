"""Make QGIS style files (.qml), which QGIS applies when it opens the file of the same name."""

import math
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from firemodel.outputs.raster_layers import Layer

DOCTYPE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"


def raster_qml(layer: Layer) -> str:
    """Return the style of a raster with one band: a colour and a label for each class.

    Args:
        layer: The layer, whose classes become the legend.

    Returns:
        The text of a .qml file (XML), with QGIS's renderer ``paletted`` for codes and
        ``singlebandpseudocolor`` for ranges.
    """
    root = Element("qgis", version="3.22.0", styleCategories="Symbology")
    pipe = SubElement(root, "pipe")
    common = {"band": "1", "opacity": "0.8", "alphaBand": "-1", "nodataColor": ""}
    if layer.categorical:
        renderer = SubElement(pipe, "rasterrenderer", type="paletted", **common)
        entries = SubElement(renderer, "colorPalette")
        for each in layer.classes:
            SubElement(
                entries,
                "paletteEntry",
                value=f"{each.upto:g}",
                color=each.colour,
                alpha="255",
                label=f"{each.upto:g}: {each.label}",
            )
    else:
        first, last = layer.classes[0].upto, layer.classes[-1].upto
        limits = {"classificationMin": f"{first!r}", "classificationMax": _number(last)}
        renderer = SubElement(pipe, "rasterrenderer", type="singlebandpseudocolor", **common)
        renderer.attrib.update(limits)
        shader = SubElement(
            SubElement(renderer, "rastershader"),
            "colorrampshader",
            colorRampType="DISCRETE",
            classificationMode="1",
            clip="0",
        )
        for each in layer.classes:
            SubElement(
                shader,
                "item",
                value=_number(each.upto),
                color=each.colour,
                alpha="255",
                label=each.label,
            )
    return _text(root)


def _number(value: float) -> str:
    return "inf" if math.isinf(value) else repr(value)


def _text(root: Element) -> str:
    indent(root)
    return DOCTYPE + tostring(root, encoding="unicode") + "\n"
