"""Plans the relief of aircraft: the sorties and batteries that keep a watch over a fire. Pure."""
