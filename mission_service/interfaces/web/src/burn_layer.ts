// A prescribed burn on the map: unit, no-drop areas, people, stations, the planned line, and all
// drops with their results.

import type { Map as MapView } from "maplibre-gl";
import { circle } from "./geo.ts";
import {
  circleLayer, collection, empty, feature, fillLayer, type Group, labelLayer,
  type Layers, line, lineLayer, point, show,
} from "./map.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";
import type { Burn, LonLat, Ring } from "./types.ts";

export const burnLayers: Layers = {
  sources: { unit: empty(), "no-drop": empty(), "burn-plan": empty(), drops: empty(), stations: empty() },
  layers: [
    lineLayer("unit", "unit", {
      "line-color": ["match", ["get", "kind"], "unit", "#000000", "#00529b"],
      "line-width": 3.5,
      "line-dasharray": [4, 1.5],
    }),
    fillLayer("no-drop", "no-drop", { "fill-color": "#00529b", "fill-opacity": 0.3, "fill-outline-color": "#00305c" }),
    lineLayer("burn-plan", "burn-plan", { "line-color": "#ad1457", "line-width": 3, "line-dasharray": [2, 1] },
      { filter: ["==", ["geometry-type"], "LineString"] }),
    circleLayer("burn-plan-drops", "burn-plan", {
      "circle-radius": 6,
      "circle-color": ["case", ["get", "skipped"], "#9e9e9e", "#ffffff"],
      "circle-stroke-color": "#ad1457",
      "circle-stroke-width": 2.5,
    }, { filter: ["==", ["geometry-type"], "Point"] }),
    circleLayer("drops", "drops", {
      "circle-radius": 6,
      "circle-color": [
        "match",
        ["get", "outcome"],
        ...["done", "#b00000", "refused", "#000000", "unknown", "#ffd600"],
        "#ff8c00",
      ] as never,
      "circle-stroke-color": "#ffffff",
      "circle-stroke-width": 2,
    }),
    lineLayer("clear-of", "stations", { "line-color": "#0b5d1e", "line-width": 2.5 },
      { filter: ["==", ["geometry-type"], "LineString"] }),
    circleLayer("stations", "stations", {
      "circle-radius": 8,
      "circle-color": "#0b5d1e",
      "circle-stroke-color": "#ffffff",
      "circle-stroke-width": 2,
    }, { filter: ["==", ["geometry-type"], "Point"] }),
    labelLayer("stations-name", "stations", "#000", {
      "text-field": ["get", "name"], "text-size": 14, "text-anchor": "top", "text-offset": [0, 0.8],
    }),
  ],
};

export const BURN_GROUPS: Record<string, Group> = {
  unit: { label: t("Burn unit and stations"), layers: ["unit", "no-drop", "clear-of", "stations", "stations-name"], shown: true },
  drops: { label: t("Planned and completed drops"), layers: ["burn-plan", "burn-plan-drops", "drops"], shown: true },
};

export function followBurn(map: MapView, store: Store): void {
  store.on(["burn"], () => {
    const burn = store.state?.burn;
    if (!burn) return;
    const { unit, fence, no_drop } = burn.guidance;
    const outline = (kind: string) => (ring: Ring) => feature(line(ring.map(lonLat)), { kind });
    show(map, "unit", collection([...unit.map(outline("unit")), ...fence.map(outline("fence"))]));
    const area = (ring: Ring): GeoJSON.Feature =>
      feature({ type: "Polygon", coordinates: [ring.map(lonLat)] });
    show(map, "no-drop", collection(no_drop.map(area)));
    show(map, "burn-plan", collection(planOf(burn)));
    show(map, "stations", collection(positionsOf(burn)));
    show(
      map,
      "drops",
      collection(burn.drops.map((drop) => feature(point([drop.lon_deg, drop.lat_deg]), { outcome: drop.outcome }))),
    );
  });
}

const lonLat = ([lat, lon]: [number, number]): LonLat => [lon, lat];

function planOf({ plan, drops, plan_hash }: Burn): GeoJSON.Feature[] {
  if (!plan) return [];
  const ordered = new Set(drops.filter((drop) => drop.plan_hash === plan_hash).map((drop) => drop.number));
  const path = plan.path.map((corner): [number, number] => [corner.lon_deg, corner.lat_deg]);
  return [
    ...(path.length > 1 ? [feature(line(path))] : []),
    ...plan.drops
      .filter((drop) => !ordered.has(drop.number))
      .map((drop) => feature(point([drop.lon_deg, drop.lat_deg]), { skipped: false })),
    ...plan.skipped.map(([lat, lon]) => feature(point([lon, lat]), { skipped: true })),
  ];
}

function positionsOf(burn: Burn): GeoJSON.Feature[] {
  const people = burn.guidance.people;
  return [
    ...burn.stations.map((one) => feature(point([one.lon_deg, one.lat_deg]), { name: one.name })),
    ...people.map(([name, lat, lon]) => feature(point([lon, lat]), { name })),
    ...people.map(([, lat, lon, radius]) => feature(line(circle([lon, lat], radius)))),
  ];
}
