"""Plans the relief of aircraft: sorties and batteries that keep a watch over a fire. Pure."""
