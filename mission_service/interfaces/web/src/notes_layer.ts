// Operators' notes on the map, from the lines of the log. A click on a note with a photo shows the photo.

import type { Map as MapView } from "maplibre-gl";
import { circleLayer, collection, empty, feature, FONT, type Group, labelLayer, type Layers, point, show } from "./map.ts";
import { t } from "./messages.ts";
import { showPhoto } from "./photos.ts";
import type { Store } from "./store.ts";

const COLOUR = "#00695c";

export const noteLayers: Layers = {
  sources: { notes: empty() },
  layers: [
    circleLayer("notes", "notes", {
      "circle-color": COLOUR, "circle-radius": ["case", ["get", "hasPhoto"], 14, 7], "circle-stroke-color": "#fff", "circle-stroke-width": 3,
    }),
    {
      id: "notes-photo", type: "symbol", source: "notes", filter: ["get", "hasPhoto"],
      layout: { ...FONT, "icon-image": "note-photo", "icon-allow-overlap": true, "icon-ignore-placement": true },
    },
    labelLayer("notes-name", "notes", COLOUR, {
      "text-field": ["get", "label"], "text-size": 14, "text-anchor": "left",
      "text-offset": ["case", ["get", "hasPhoto"], ["literal", [1.4, 0]], ["literal", [0.9, 0]]],
      "text-max-width": 14, "text-justify": "left",
    }),
  ],
};

export const NOTE_GROUPS: Record<string, Group> = {
  notes: { label: t("Notes"), layers: ["notes", "notes-photo", "notes-name"], shown: true },
};

/** Keep the notes up to date. */
export function followNotes(map: MapView, store: Store): void {
  map.addImage("note-photo", icon(), { pixelRatio: 2 });
  store.on(["records"], () => {
    const notes = (store.state?.records ?? []).flatMap(({ id, note, photo, lat_deg, lon_deg }) =>
      note && lat_deg !== null && lon_deg !== null
        ? [feature(point([lon_deg, lat_deg]), { id, label: note, hasPhoto: Boolean(photo) })]
        : []);
    show(map, "notes", collection(notes));
  });
  map.on("click", "notes", ({ features }) => {
    const note = store.state?.records.find(({ id }) => id === features?.[0]?.properties.id);
    if (note?.photo) void showPhoto(note);
  });
}

/** A white camera. */
function icon(): ImageData {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 36;
  const pen = canvas.getContext("2d")!;
  pen.fillStyle = "#ffffff";
  pen.fill(new Path2D("M3 12 a3 3 0 0 1 3 -3 h6 l3 -4 h6 l3 4 h6 a3 3 0 0 1 3 3 v15 a3 3 0 0 1 -3 3 h-24 a3 3 0 0 1 -3 -3 z"));
  pen.fillStyle = COLOUR;
  pen.fill(new Path2D("M18 12 a7 7 0 1 1 -0.01 0 z"));
  return pen.getImageData(0, 0, 36, 36);
}
