// People and values at risk on the map, with the time until the fire may reach them.

import type { ExpressionSpecification, Map as MapView } from "maplibre-gl";
import { circleLayer, collection, empty, feature, type Group, labelLayer, type Layers, point, show } from "./map.ts";
import { t } from "./messages.ts";
import { PALETTE } from "./palette.ts";
import type { Store } from "./store.ts";
import type { FireArrival } from "./types.ts";
import { duration } from "./units.ts";

const COLOUR: ExpressionSpecification = ["get", "colour"];
const LABEL_WITHIN_S = 6 * 3600;

export const arrivalLayers: Layers = {
  sources: { arrivals: empty() },
  layers: [
    circleLayer("arrivals", "arrivals", {
      "circle-color": COLOUR, "circle-radius": 7, "circle-stroke-color": "#fff", "circle-stroke-width": 2,
    }),
    labelLayer("arrivals-name", "arrivals", PALETTE.arrival.none, {
      "text-field": ["get", "label"], "text-size": 14, "text-anchor": "left", "text-offset": [0.9, 0],
      "text-justify": "left", "symbol-sort-key": ["get", "order"],
    }),
  ],
};

export const ARRIVAL_GROUPS: Record<string, Group> = {
  arrivals: { label: t("People and values at risk"), layers: ["arrivals", "arrivals-name"], shown: true },
};

/** Keep the people and values at risk up to date. */
export function followArrivals(map: MapView, store: Store): void {
  store.on(["fire_arrivals", "alarms"], () => {
    const alarms = new Map((store.state?.alarms ?? []).map(({ alarm, severity }) => [alarm, severity]));
    const marks = (store.state?.fire_arrivals ?? []).map((each, order) =>
      feature(point([each.lon_deg, each.lat_deg]), {
        order,
        label: labelOf(each),
        colour: PALETTE.arrival[alarms.get(`fire_arrival/${each.key}`) ?? "none"],
      }));
    show(map, "arrivals", collection(marks));
  });
}

/** The name, and the time until the fire may arrive: "Engine 3 · 12 min". */
export function labelOf(each: FireArrival): string {
  const left = leftS(each.early_at_us, each);
  return left === null || left > LABEL_WITHIN_S ? each.name : `${each.name} · ${left > 0 ? rounded(left) : t("now")}`;
}

/** The time until `at_us`, to the minute. */
export const rounded = (s: number): string => duration(60 * Math.ceil(s / 60));

/** The seconds until a time of an arrival; null for a time after the forecast. */
export const leftS = (atUs: number | null, each: FireArrival): number | null =>
  atUs === null ? null : (atUs - each.at_us) / 1e6;
