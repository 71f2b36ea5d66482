// Vehicles, their tracks, missions and orbits: one source of each kind for all vehicles.

import type { ExpressionSpecification, Map as MapView } from "maplibre-gl";
import { get } from "./api.ts";
import { coalesced } from "./coalesce.ts";
import { circle } from "./geo.ts";
import {
  circleLayer, collection, empty, feature, fillLayer, type Group, iconLayer,
  labelLayer, type Layers, line, lineLayer, point, show,
} from "./map.ts";
import { t } from "./messages.ts";
import { PALETTE } from "./palette.ts";
import { type Store, TRACK_S, type TrackPoint } from "./store.ts";
import { type Item, LOITER_UNLIMITED, type LonLat, type Mission, type Telemetry, type Vehicle } from "./types.ts";
import { length, speed } from "./units.ts";

const LOITER_RADIUS_PARAM: Record<number, number> = { 17: 2, 18: 2, 19: 2, 31: 1 };
const DEFAULT_RADIUS_M = 80;
const FULL_LABELS = 16; // with more vehicles labels contain only the name
// Minimum times between two updates of a source, which limit the load of a hundred vehicles.
const [POSITIONS_MS, MISSIONS_MS, TRACKS_MS] = [200, 300, 1000];

export const vehicleLayers: Layers = {
  sources: { tracks: empty(), missions: empty(), orbits: empty(), vehicles: empty() },
  layers: [
    fillLayer("coverage", "orbits", { "fill-color": "#00838f", "fill-opacity": 0.18 },
      { filter: ["==", ["get", "part"], "coverage"] }),
    lineLayer("tracks", "tracks", {
      "line-color": ["case", ["get", "chosen"], ageColour("#08306b", "#9ecae1"), ageColour("#222222", "#bdbdbd")],
      "line-width": ["case", ["get", "chosen"], 2.5, 1.5],
    }),
    lineLayer("orbits", "orbits", { "line-color": "#006064", "line-width": 2 },
      { filter: ["==", ["get", "part"], "orbit"] }),
    lineLayer("mission-halo", "missions", { "line-color": "#ffffff", "line-width": 7 },
      { filter: ["all", ["==", ["get", "part"], "path"], ["get", "chosen"]] }),
    lineLayer("mission-path", "missions", {
      "line-color": missionColour(),
      "line-width": ["case", ["get", "chosen"], 4, 2],
      "line-opacity": ["case", ["get", "chosen"], 1, 0.6],
    }, { filter: ["==", ["get", "part"], "path"] }),
    circleLayer("mission-item", "missions", {
      "circle-color": ["case", ["get", "current"], "#ffd600", "#ffffff"],
      "circle-radius": ["case", ["get", "current"], 9, 5],
      "circle-stroke-color": missionColour(),
      "circle-stroke-width": ["case", ["get", "current"], 4, 2],
    }, { filter: ["==", ["get", "part"], "item"] }),
    labelLayer("mission-number", "missions", "#0b3d91", {
      "text-field": ["get", "number"], "text-size": 13, "text-offset": [0.9, -0.9], "text-optional": true,
    }, { minzoom: 12, filter: ["==", ["get", "part"], "item"] }),
    iconLayer("vehicles", "heading", {
      "text-size": 14, "text-radial-offset": 1.6, "symbol-sort-key": ["case", ["get", "chosen"], 0, 1],
    }, "#000"),
  ],
};

/** The colour of a part of a track, from the newest to the oldest. */
function ageColour(newest: string, oldest: string): ExpressionSpecification {
  return ["interpolate", ["linear"], ["get", "age"], 0, newest, 1, oldest];
}

function missionColour(): ExpressionSpecification {
  const { onBoard, sending, proposed } = PALETTE.missions;
  return ["match", ["get", "kind"], "on board", onBoard, "sending", sending, proposed];
}

export const VEHICLE_GROUPS: Record<string, Group> = {
  tracks: { label: t("Tracks (paler with age)"), layers: ["tracks"], shown: true },
  missions: {
    label: t("Missions"),
    layers: ["mission-halo", "mission-path", "mission-item", "mission-number"],
    shown: true,
  },
  orbits: { label: t("Orbits"), layers: ["orbits"], shown: true },
  coverage: { label: t("Coverage of orbits"), layers: ["coverage"], shown: true },
};

/** Keep the sources of the vehicles up to date; select a vehicle that is clicked. */
export function followVehicles(map: MapView, store: Store): void {
  for (const kind of ["plane", "copter"]) {
    for (const [state, colour] of Object.entries(PALETTE.vehicles)) {
      map.addImage(`${kind}-${state}`, icon(kind, colour), { pixelRatio: 2 });
    }
  }
  const positions = coalesced(async () => {
    show(map, "vehicles", collection([...store.telemetry.values()].map((fix) => mark(store, fix))));
  }, POSITIONS_MS);
  const tracks = coalesced(async () => {
    show(map, "tracks", collection(tracksOf(store)));
  }, TRACKS_MS);
  const missions = coalesced(async () => {
    show(map, "missions", collection(missionsOf(store)));
    show(map, "orbits", collection(orbitsOf(store)));
  }, MISSIONS_MS);
  store.on(["telemetry", "vehicle", "chosen"], positions);
  store.on(["telemetry", "chosen"], tracks);
  store.on(["mission", "vehicle", "chosen"], missions);
  map.on("click", "vehicles", ({ features }) => {
    const name: unknown = features?.[0]?.properties.vehicle;
    if (typeof name === "string") store.choose(name);
  });
}

interface FlownTrack {
  geometry: GeoJSON.LineString | null;
  properties: { at_us: number[] };
}

/** Read the tracks from before this page was opened, or while it was too slow. */
export async function fetchTracks(store: Store): Promise<void> {
  store.missed = false;
  const MOST = 20;
  for (const name of [...store.vehicles.keys()].slice(0, MOST)) {
    const afterUs = Math.round((store.nowS - TRACK_S) * 1e6);
    const path = `vehicles/${name}/track?after_us=${afterUs}&limit=${TRACK_S}`;
    const track = await get<FlownTrack>(path).catch(() => null);
    if (!track) {
      store.missed = true; // to be requested again
      continue;
    }
    const flown = (track.geometry?.coordinates ?? []).map(([lon, lat], i): TrackPoint => [
      lon!,
      lat!,
      (track.properties.at_us[i] ?? 0) / 1e6,
    ]);
    const untilS = flown.at(-1)?.[2] ?? -Infinity;
    const since = (store.tracks.get(name) ?? []).filter(([, , atS]) => atS > untilS);
    store.tracks.set(name, [...flown, ...since]);
  }
  store.changed("telemetry");
}

function mark(store: Store, fix: Telemetry): GeoJSON.Feature {
  const vehicle = store.vehicles.get(fix.vehicle);
  const chosen = store.chosen === fix.vehicle;
  const lost = vehicle?.link !== "online";
  const state = lost ? "lost" : chosen ? "chosen" : "online";
  return feature(point([fix.lon_deg, fix.lat_deg]), {
    vehicle: fix.vehicle,
    heading: fix.heading_deg,
    chosen,
    icon: `${vehicle?.kind === "copter" ? "copter" : "plane"}-${state}`,
    label: labelOf(fix, vehicle, store.telemetry.size <= FULL_LABELS || chosen),
  });
}

/** Name, height above ground (or home) and speed, or a lost link. */
function labelOf(fix: Telemetry, vehicle: Vehicle | undefined, full: boolean): string {
  if (vehicle?.link === "lost") return `${fix.vehicle}\n${t("LINK LOST")}`;
  if (!full) return fix.vehicle;
  const height = fix.height_agl_m ?? fix.altitude_relative_m;
  return `${fix.vehicle}\n${length(height)}  ${speed(fix.ground_speed_m_s)}`;
}

/** The tracks in parts of similar age, which are drawn from the oldest to the newest. */
function tracksOf(store: Store): GeoJSON.Feature[] {
  const PARTS = 6;
  const features: GeoJSON.Feature[] = [];
  for (let part = PARTS - 1; part >= 0; part--) {
    const [newestS, oldestS] = [part, part + 1].map((each) => store.nowS - (each * TRACK_S) / PARTS) as [number, number];
    for (const [name, points] of store.tracks) {
      const first = points.findIndex(([, , atS]) => atS >= oldestS);
      if (first < 0) continue;
      const end = points.findIndex(([, , atS]) => atS >= newestS);
      const of = points.slice(first, part === 0 || end < 0 ? undefined : end + 1); // parts share a point
      if (of.length < 2) continue;
      const path = line(of.map(([lon, lat]): LonLat => [lon, lat]));
      features.push(feature(path, { chosen: name === store.chosen, age: part / (PARTS - 1) }));
    }
  }
  return features;
}

function missionsOf(store: Store): GeoJSON.Feature[] {
  return [...store.missions.values()].flatMap((mission) => {
    const chosen = mission.vehicle === store.chosen;
    const seq = store.vehicles.get(mission.vehicle)?.current_seq ?? null;
    return [
      ...parts(mission.on_board, "on board", chosen, seq),
      ...(chosen ? parts(mission.sending, "sending", chosen, null) : []),
      ...(chosen ? parts(mission.proposed, "proposed", chosen, null) : []),
    ];
  });
}

/** A mission as features: its path, and for the chosen vehicle its items. */
function parts(mission: Mission | null, kind: string, chosen: boolean, currentSeq: number | null): GeoJSON.Feature[] {
  if (!mission) return [];
  const path: LonLat[] = [];
  const features: GeoJSON.Feature[] = [];
  for (const [seq, item] of mission.items.entries()) {
    const position = positionOf(item);
    if (!position) continue;
    path.push(position);
    const radius = radiusOf(item);
    if (radius) features.push(feature(line(circle(position, radius)), { part: "path", kind, chosen }));
    if (chosen) {
      const current = seq === currentSeq;
      features.push(feature(point(position), { part: "item", kind, chosen, current, number: `${seq}` }));
    }
    // The vehicle flies the items after an unlimited loiter (a landing) only on an order.
    if (item.command === LOITER_UNLIMITED) break;
  }
  if (path.length > 1) features.unshift(feature(line(path), { part: "path", kind, chosen }));
  return features;
}

function positionOf(item: Item): LonLat | null {
  return item.lat_deg === null || item.lon_deg === null ? null : [item.lon_deg, item.lat_deg];
}

function radiusOf(item: Item): number | null {
  const param = LOITER_RADIUS_PARAM[item.command];
  if (param === undefined) return null;
  return Math.abs(item.params[param] ?? 0) || DEFAULT_RADIUS_M;
}

function orbitsOf(store: Store): GeoJSON.Feature[] {
  return [...store.vehicles.values()].flatMap((vehicle) => {
    if (!vehicle.orbit) return [];
    const { lat_deg, lon_deg, radius_m, view_width_m } = vehicle.orbit;
    const middle: LonLat = [lon_deg, lat_deg];
    const [inner, outer] = [-1, 1].map((side) => Math.abs(radius_m) + (side * view_width_m) / 2);
    const covered = [circle(middle, outer!), ...(inner! > 0 ? [circle(middle, inner!)] : [])];
    return [
      feature({ type: "Polygon", coordinates: covered }, { part: "coverage" }),
      feature(line(circle(middle, Math.abs(radius_m))), { part: "orbit" }),
    ];
  });
}

/** The icon of a plane or copter with heading north, with a white rim for contrast. */
function icon(kind: string, colour: string): ImageData {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 72;
  const pen = canvas.getContext("2d")!;
  const shape = new Path2D(
    kind === "plane"
      ? "M36 4 L42 26 L68 40 L68 48 L42 42 L40 58 L50 64 L50 69 L36 65 L22 69 L22 64 L32 58 L30 42 L4 48 L4 40 L30 26 Z"
      : "M36 2 L48 20 L40 18 L40 30 L54 18 L62 26 L48 40 L62 54 L54 62 L36 48 L18 62 L10 54 L24 40 L10 26 L18 18 L32 30 L32 18 L24 20 Z",
  );
  pen.lineJoin = "round";
  pen.lineWidth = 6;
  pen.strokeStyle = "#ffffff";
  pen.stroke(shape);
  pen.fillStyle = colour;
  pen.fill(shape);
  return pen.getImageData(0, 0, 72, 72);
}
