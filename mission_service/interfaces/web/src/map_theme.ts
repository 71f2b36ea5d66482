// The colours of the ground and of labels on the map in each theme; fire and vehicles keep theirs.

import type { ExpressionSpecification, Map as MapView } from "maplibre-gl";
import { onPreferences, shownTheme, type Theme } from "./preferences.ts";

interface Colours {
  paper: string;
  shadow: string;
  highlight: string;
  accent: string;
}

const COLOURS: Record<Exclude<Theme, "auto">, Colours> = {
  day: { paper: "#efece3", shadow: "#5b5348", highlight: "#ffffff", accent: "#8a8170" },
  night: { paper: "#1d2329", shadow: "#05080a", highlight: "#5d6b77", accent: "#0c1013" },
  contrast: { paper: "#ffffff", shadow: "#8a8a8a", highlight: "#ffffff", accent: "#bbbbbb" },
};

// Lines that would be too dark on the ground by night.
const NIGHT_LINES: Record<string, ExpressionSpecification | string> = {
  "front-now-line": "#ff7b6b",
  "front-then-line": "#ffb74d",
  contours: "#ffcc80",
  "uncertainty-line": "#ce93d8",
  "preview-line": "#8ab8ff",
  orbits: "#4dd0e1",
  "relief-contours": "#a58a68",
  "relief-drainage": "#5aa9e0",
  tracks: ["interpolate", ["linear"], ["get", "age"], 0, "#d6e6ff", 1, "#5b7390"],
};

/** Show the theme's colours on the map, now and after each change; returns the function for new layers. */
export function followTheme(map: MapView): () => void {
  const byDay = new Map<string, unknown>(); // the colours of labels and lines
  const set = (layer: string, name: "text-color" | "text-halo-color" | "line-color", night: unknown): void => {
    const key = `${layer}/${name}`;
    if (!byDay.has(key)) byDay.set(key, map.getPaintProperty(layer, name));
    map.setPaintProperty(layer, name, (shownTheme() === "night" ? night : byDay.get(key)) as string);
  };
  const apply = (): void => {
    const { paper, shadow, highlight, accent } = COLOURS[shownTheme()];
    map.setPaintProperty("paper", "background-color", paper);
    if (map.getLayer("hillshade")) {
      map.setPaintProperty("hillshade", "hillshade-shadow-color", shadow);
      map.setPaintProperty("hillshade", "hillshade-highlight-color", highlight);
      map.setPaintProperty("hillshade", "hillshade-accent-color", accent);
    }
    for (const { id, type } of map.getStyle().layers) {
      if (type !== "symbol" || id.startsWith("basemap-")) continue; // files have colours for each theme
      set(id, "text-color", "#ffffff");
      set(id, "text-halo-color", "#0b0f13");
    }
    for (const [layer, night] of Object.entries(NIGHT_LINES)) {
      if (map.getLayer(layer)) set(layer, "line-color", night);
    }
  };
  onPreferences(apply);
  apply();
  return apply;
}
