// Other aircraft: a symbol in the colour of the alert, its name, relative height, and its path in the next minute.

import type { ExpressionSpecification, Map as MapView } from "maplibre-gl";
import { coalesced } from "./coalesce.ts";
import { pointAt } from "./geo.ts";
import { collection, empty, feature, type Group, iconLayer, type Layers, line, lineLayer, point, show } from "./map.ts";
import { t } from "./messages.ts";
import { PALETTE } from "./palette.ts";
import type { Store } from "./store.ts";
import type { Aircraft, LonLat } from "./types.ts";
import { difference } from "./units.ts";

const EVERY_MS = 300;
const AHEAD_S = 60;
const COLOURS = PALETTE.aircraft;
const URGENCY = ["warning", "corrective", "preventive", "none"]; // labels of the first are drawn first
const ALERTS: Record<Aircraft["alert"], string> = {
  none: "", preventive: t("PREVENTIVE"), corrective: t("CORRECTIVE"), warning: t("WARNING"),
};
const COLOUR: ExpressionSpecification = ["get", "colour"];

export const aircraftLayers: Layers = {
  sources: { aircraft: empty(), "aircraft-ahead": empty() },
  layers: [
    lineLayer("aircraft-ahead", "aircraft-ahead", { "line-color": COLOUR, "line-width": 2, "line-dasharray": [2, 1.5] }),
    iconLayer("aircraft", "track", {
      "text-size": 13, "text-radial-offset": 1.3, "symbol-sort-key": ["get", "order"],
    }, COLOUR),
  ],
};

export const AIRCRAFT_GROUPS: Record<string, Group> = {
  aircraft: { label: t("Other aircraft"), layers: ["aircraft-ahead", "aircraft"], shown: true },
};

/** Keep the other aircraft up to date. */
export function followAircraft(map: MapView, store: Store): void {
  for (const [alert, colour] of Object.entries(COLOURS)) map.addImage(`aircraft-${alert}`, icon(colour), { pixelRatio: 2 });
  const refresh = coalesced(async () => {
    const aircraft = store.state?.aircraft ?? [];
    show(map, "aircraft", collection(aircraft.map(mark)));
    show(map, "aircraft-ahead", collection(aircraft.filter((each) => each.ground_speed_m_s > 1).map(ahead)));
  }, EVERY_MS);
  store.on(["aircraft"], refresh);
}

function mark(each: Aircraft): GeoJSON.Feature {
  return feature(point([each.lon_deg, each.lat_deg]), {
    icon: `aircraft-${each.alert}`,
    track: each.track_deg,
    alert: each.alert,
    order: URGENCY.indexOf(each.alert),
    colour: COLOURS[each.alert],
    label: labelOf(each),
  });
}

/** The name, the height above or below the vehicle, climb or descent, and the alert. */
export function labelOf(each: Aircraft): string {
  const trend = each.climb_m_s > 1 ? " ↑" : each.climb_m_s < -1 ? " ↓" : "";
  const lines = [
    each.callsign || each.aircraft,
    `${difference(each.above_m)}${trend}`,
  ];
  if (each.alert !== "none") lines.push(t("{alert} for {vehicle}", { alert: ALERTS[each.alert], vehicle: each.vehicle }));
  return lines.join("\n");
}

/** The path in the next minute. */
function ahead(each: Aircraft): GeoJSON.Feature {
  const here: LonLat = [each.lon_deg, each.lat_deg];
  const there = pointAt(here, each.track_deg, AHEAD_S * each.ground_speed_m_s);
  return feature(line([here, there]), { colour: COLOURS[each.alert] });
}

/** A pointed triangle towards the north, unlike the vehicles of the run, with a white rim. */
function icon(colour: string): ImageData {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 56;
  const pen = canvas.getContext("2d")!;
  const shape = new Path2D("M28 5 L48 49 L28 38 L8 49 Z");
  pen.lineJoin = "round";
  pen.lineWidth = 6;
  pen.strokeStyle = "#ffffff";
  pen.stroke(shape);
  pen.fillStyle = colour;
  pen.fill(shape);
  return pen.getImageData(0, 0, 56, 56);
}
