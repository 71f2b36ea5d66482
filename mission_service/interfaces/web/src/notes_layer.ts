// Operators' notes on the map, from the lines of the log.

import type { Map as MapView } from "maplibre-gl";
import { circleLayer, collection, empty, feature, type Group, labelLayer, type Layers, point, show } from "./map.ts";
import type { Store } from "./store.ts";

const COLOUR = "#00695c";

export const noteLayers: Layers = {
  sources: { notes: empty() },
  layers: [
    circleLayer("notes", "notes", {
      "circle-color": COLOUR, "circle-radius": 7, "circle-stroke-color": "#fff", "circle-stroke-width": 3,
    }),
    labelLayer("notes-name", "notes", COLOUR, {
      "text-field": ["get", "label"], "text-size": 14, "text-anchor": "left", "text-offset": [0.9, 0],
      "text-max-width": 14, "text-justify": "left",
    }),
  ],
};

export const NOTE_GROUPS: Record<string, Group> = {
  notes: { label: "Notes", layers: ["notes", "notes-name"], shown: true },
};

/** Keep the notes up to date. */
export function followNotes(map: MapView, store: Store): void {
  store.on(["records"], () => {
    const notes = (store.state?.records ?? []).flatMap(({ note, lat_deg, lon_deg }) =>
      note && lat_deg !== null && lon_deg !== null ? [feature(point([lon_deg, lat_deg]), { label: note })] : []);
    show(map, "notes", collection(notes));
  });
}
