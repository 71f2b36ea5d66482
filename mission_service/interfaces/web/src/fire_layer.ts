// The fire: now, at the slider's time, after 30 and 60 minutes, arrival times, and uncertainty.

import type { ExpressionSpecification, ImageSource, Map as MapView } from "maplibre-gl";
import { BASE, get } from "./api.ts";
import { coalesced } from "./coalesce.ts";
import {
  circleLayer, collection, empty, feature, fillLayer, type Group, labelLayer,
  type Layers, line, lineLayer, point, show,
} from "./map.ts";
import { t } from "./messages.ts";
import { PALETTE } from "./palette.ts";
import { COLOURS } from "./pens.ts";
import type { Store } from "./store.ts";
import type { Correction, LonLat } from "./types.ts";

export interface ArrivalScale {
  corners: [LonLat, LonLat, LonLat, LonLat]; // NW, NE, SE, SW
  scale: { at_s: number; colour: string }[];
}

const HIDDEN = { layout: { visibility: "none" } } as const; // until its box is checked

export const fireLayers: Layers = {
  sources: {
    uncertainty: empty(),
    "front-now": empty(),
    "front-then": empty(),
    contours: empty(),
    corrections: empty(),
    preview: empty(),
  },
  layers: [
    fillLayer("uncertainty", "uncertainty", { "fill-color": "#5b2a9d", "fill-opacity": 0.12 }, HIDDEN),
    lineLayer("uncertainty-line", "uncertainty", {
      "line-color": "#4a148c",
      "line-width": ["case", ["==", ["get", "probability"], 0.5], 3, 1.5],
    }, HIDDEN),
    labelLayer("uncertainty-name", "uncertainty", "#2e0a5e", {
      visibility: "none", "symbol-placement": "line",
      "text-field": ["concat", ["to-string", ["round", ["*", 100, ["get", "probability"]]]], " %"],
      "text-size": 14,
    }),
    fillLayer("front-now", "front-now", { "fill-color": "#d7301f", "fill-opacity": 0.42 }),
    lineLayer("front-now-line", "front-now", { "line-color": PALETTE.fire.now, "line-width": 3 }),
    lineLayer("contours", "contours", { "line-color": "#7a3b00", "line-width": 2.5, "line-dasharray": [3, 2] }, HIDDEN),
    labelLayer("contours-name", "contours", "#4a2400", {
      visibility: "none", "symbol-placement": "line",
      "text-field": ["concat", "+", ["to-string", ["*", 5, ["round", ["/", ["get", "in_s"], 300]]]], " min"],
      "text-size": 14,
    }),
    fillLayer("front-then", "front-then", { "fill-color": "#ff8c00", "fill-opacity": 0.25 }),
    lineLayer("front-then-line", "front-then", { "line-color": PALETTE.fire.then, "line-width": 3, "line-dasharray": [2, 1] }),
    fillLayer("corrections-area", "corrections", { "fill-color": stateColour(), "fill-opacity": 0.15 },
      { filter: ["==", ["geometry-type"], "Polygon"] }),
    lineLayer("corrections-line", "corrections", { "line-color": stateColour(), "line-width": 3 },
      { filter: ["!=", ["geometry-type"], "Point"] }),
    circleLayer("corrections-point", "corrections", {
      "circle-color": stateColour(),
      "circle-radius": 6,
      "circle-stroke-color": "#fff",
      "circle-stroke-width": 2,
    }, { filter: ["==", ["geometry-type"], "Point"] }),
    lineLayer("preview-halo", "preview", { "line-color": "#fff", "line-width": 7 }),
    lineLayer("preview-line", "preview", { "line-color": PALETTE.fire.preview, "line-width": 4, "line-dasharray": [2, 1] }),
  ],
};

function stateColour(): ExpressionSpecification {
  return ["match", ["get", "state"], ...Object.entries(COLOURS).flat(), "#333"] as never;
}

export const FIRE_GROUPS: Record<string, Group> = {
  arrival: { label: t("Time of arrival"), layers: ["arrival"], shown: false },
  uncertainty: {
    label: t("Uncertainty (10, 50, 90 %)"),
    layers: ["uncertainty", "uncertainty-line", "uncertainty-name"],
    shown: false,
  },
  contours: { label: t("In 30 and 60 min"), layers: ["contours", "contours-name"], shown: false },
  corrections: {
    label: t("Corrections"),
    layers: ["corrections-area", "corrections-line", "corrections-point"],
    shown: true,
  },
  hillshade: { label: t("Hillshade"), layers: ["hillshade"], shown: true },
};

/** Keep the sources of the fire up to date; request only the layers that are visible. */
export function followFire(
  map: MapView,
  store: Store,
  shown: (group: string) => boolean,
  onScale: (scale: ArrivalScale | null) => void,
): { refresh: () => void } {
  const now = coalesced(async () => {
    show(map, "front-now", await get<GeoJSON.GeoJSON>("fire/front"));
  }, 1000);

  const then = coalesced(async () => {
    const inMin = store.inMin;
    const data = inMin
      ? await get<GeoJSON.GeoJSON>(`fire/front?in_s=${inMin * 60}`)
      : collection();
    if (inMin === store.inMin) show(map, "front-then", data);
  }, 150);

  const unsure = coalesced(async () => {
    if (!shown("uncertainty")) return;
    const inMin = store.inMin > 0 ? store.inMin : 60;
    show(map, "uncertainty", await get<GeoJSON.GeoJSON>(`fire/uncertainty?in_min=${inMin}`));
  }, 1000);

  const contours = coalesced(async () => {
    if (!shown("contours")) return;
    show(map, "contours", await get<GeoJSON.GeoJSON>("fire/contours?in_min=30&in_min=60"));
  }, 1000);

  const arrival = coalesced(async () => {
    if (!shown("arrival")) return onScale(null);
    const until = Math.round(store.nowS + Math.max(60, store.inMin) * 60);
    const scale = await get<ArrivalScale>(`fire/arrival.json?until_s=${until}`);
    overlay(map, `${BASE}fire/arrival.png?until_s=${until}`, scale.corners);
    onScale(scale);
  }, 2000);

  const drawn = (): void =>
    show(map, "corrections", collection((store.state?.fire.corrections ?? []).map(markOf)));

  store.on(["preview"], () => show(map, "preview", store.preview ?? collection()));
  store.on(["fire"], () => {
    now();
    if (store.inMin) then();
    unsure();
    contours();
    arrival();
    drawn();
  });
  store.on(["moment"], () => {
    then();
    unsure();
    arrival();
  });
  return {
    refresh: () => {
      unsure();
      contours();
      arrival();
    },
  };
}

/** Show the image of arrival times, below the fire. */
function overlay(map: MapView, url: string, coordinates: ArrivalScale["corners"]): void {
  const source = map.getSource("arrival") as ImageSource | undefined;
  if (source) {
    source.updateImage({ url, coordinates });
    return;
  }
  map.addSource("arrival", { type: "image", url, coordinates });
  map.addLayer(
    {
      id: "arrival",
      type: "raster",
      source: "arrival",
      paint: { "raster-opacity": 0.75, "raster-fade-duration": 0, "raster-resampling": "nearest" },
    },
    "front-now",
  );
}

/** A correction as a map feature. */
export function markOf(mark: Correction): GeoJSON.Feature {
  const points = mark.points.map(([lat, lon]): [number, number] => [lon, lat]);
  const properties = { state: mark.state };
  if (mark.shape === "point") return feature(point(points[0]!), properties);
  if (mark.shape === "line") return feature(line(points), properties);
  return feature({ type: "Polygon", coordinates: [[...points, points[0]!]] }, properties);
}
