// Range rings around the chosen vehicle, with radii that are round in the chosen units.

import type { Map as MapView } from "maplibre-gl";
import { coalesced } from "./coalesce.ts";
import { circle, pointAt } from "./geo.ts";
import { collection, empty, feature, type Group, labelLayer, type Layers, line, lineLayer, point, show } from "./map.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";
import type { LonLat } from "./types.ts";
import { distance, ringRadii } from "./units.ts";

const EVERY_MS = 500;
const SHARE = 0.5; // of the smaller side of the map, for the largest ring
const HIDDEN = { layout: { visibility: "none" } } as const; // until its box is checked

export const ringLayers: Layers = {
  sources: { rings: empty() },
  layers: [
    lineLayer("rings-halo", "rings", { "line-color": "#fff", "line-width": 3.5, "line-opacity": 0.8 },
      { ...HIDDEN, filter: ["==", ["geometry-type"], "LineString"] }),
    lineLayer("rings", "rings", { "line-color": "#333", "line-width": 1.5, "line-dasharray": [4, 3] },
      { ...HIDDEN, filter: ["==", ["geometry-type"], "LineString"] }),
    labelLayer("rings-name", "rings", "#111", {
      visibility: "none", "text-field": ["get", "label"], "text-size": 13, "text-allow-overlap": true,
    }, { filter: ["==", ["geometry-type"], "Point"] }),
  ],
};

export const RING_GROUPS: Record<string, Group> = {
  rings: { label: t("Range rings"), layers: ["rings-halo", "rings", "rings-name"], shown: false },
};

/** Keep the rings around the chosen vehicle; their radii follow the zoom. Returns the function that redraws them. */
export function followRings(map: MapView, store: Store, shown: () => boolean): () => void {
  const refresh = coalesced(async () => {
    const fix = store.telemetry.get(store.chosen);
    if (!shown() || !fix) return show(map, "rings", collection());
    const middle: LonLat = [fix.lon_deg, fix.lat_deg];
    const { clientWidth, clientHeight } = map.getContainer();
    const edge = map.unproject([0, 0]).distanceTo(map.unproject([Math.min(clientWidth, clientHeight), 0]));
    show(map, "rings", collection(ringRadii(SHARE * edge).flatMap((radiusM) => [
      feature(line(circle(middle, radiusM))),
      feature(point(pointAt(middle, 0, radiusM)), { label: distance(radiusM) }),
    ])));
  }, EVERY_MS);
  store.on(["telemetry", "chosen"], refresh);
  map.on("zoomend", refresh);
  return refresh;
}
