// The measured line, with its length and the bearing from its first to its last point.

import { LngLat, type Map as MapView } from "maplibre-gl";
import { collection, empty, feature, labelLayer, type Layers, line, lineLayer, point, show } from "./map.ts";
import type { Store } from "./store.ts";
import { distance } from "./units.ts";

const RAD_PER_DEG = Math.PI / 180;

export const measureLayers: Layers = {
  sources: { measured: empty() },
  layers: [
    lineLayer("measured-halo", "measured", { "line-color": "#fff", "line-width": 6 }),
    lineLayer("measured-line", "measured", { "line-color": "#111", "line-width": 3 }),
    labelLayer("measured-name", "measured", "#111", {
      "text-field": ["get", "label"], "text-size": 16, "text-anchor": "bottom", "text-offset": [0, -0.6],
      "text-allow-overlap": true,
    }, { filter: ["==", ["geometry-type"], "Point"] }),
  ],
};

/** The initial bearing of the great circle from one place to another (lat, lon), in degrees from true north. */
export function bearingDeg([latA, lonA]: [number, number], [latB, lonB]: [number, number]): number {
  const [a, b, turn] = [latA * RAD_PER_DEG, latB * RAD_PER_DEG, (lonB - lonA) * RAD_PER_DEG];
  const east = Math.sin(turn) * Math.cos(b);
  const north = Math.cos(a) * Math.sin(b) - Math.sin(a) * Math.cos(b) * Math.cos(turn);
  return (Math.atan2(east, north) / RAD_PER_DEG + 360) % 360;
}

/** The label of a line: "1.2 km (0.7 mi), 047°". */
export function measuredText(points: [number, number][]): string {
  const places = points.map(([lat, lon]) => new LngLat(lon, lat));
  const lengthM = places.slice(1).reduce((sum, place, index) => sum + places[index]!.distanceTo(place), 0);
  const bearing = Math.round(bearingDeg(points[0]!, points.at(-1)!)) % 360;
  return `${distance(lengthM)}, ${String(bearing).padStart(3, "0")}°`;
}

/** Draw the measured line of the store. */
export function followMeasured(map: MapView, store: Store): void {
  store.on(["measured"], () => {
    const places = store.measured.map(([lat, lon]): [number, number] => [lon, lat]);
    const label = places.length > 1 ? measuredText(store.measured) : "";
    show(map, "measured", label
      ? collection([feature(line(places)), feature(point(places.at(-1)!), { label })])
      : collection());
  });
}
