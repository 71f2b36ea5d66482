// The page: everything is made here and follows the one store.

import "./style.css";
import type { Map as MapView } from "maplibre-gl";
import { Alarms } from "./alarms.ts";
import { get, whenUnauthorised } from "./api.ts";
import { BURN_GROUPS, burnLayers, followBurn } from "./burn_layer.ts";
import { askForToken, showHelp } from "./dialogs.ts";
import { byId } from "./dom.ts";
import { FIRE_GROUPS, fireLayers, followFire } from "./fire_layer.ts";
import { around, placesOf } from "./geo.ts";
import { listenForKeys, shortcut } from "./keys.ts";
import { makeMap } from "./map.ts";
import { BurnPanel } from "./panels/burn.ts";
import { FirePanel, type Group } from "./panels/fire.ts";
import { logPanel } from "./panels/log.ts";
import { PlannerPanel } from "./panels/planner.ts";
import { VehiclesPanel } from "./panels/vehicles.ts";
import { Pens } from "./pens.ts";
import { replayBar } from "./replay_bar.ts";
import { side } from "./side.ts";
import { Store } from "./store.ts";
import { timeBar } from "./time_bar.ts";
import { takeToken, token } from "./token.ts";
import { Toolbar } from "./toolbar.ts";
import { topBar } from "./top_bar.ts";
import type { LonLat } from "./types.ts";
import { fetchTracks, followVehicles, VEHICLE_GROUPS, vehicleLayers } from "./vehicles_layer.ts";

const groups: Record<string, Group> = { ...FIRE_GROUPS, ...VEHICLE_GROUPS, ...BURN_GROUPS };
const store = new Store();
const TRACKS_AGAIN_MS = 10_000;
const TRACKS_OF_REPLAY_MS = 2000; // which may go a hundred times as fast
let map: MapView | null = null;
let pens: Pens | null = null;
let refreshFire: () => void = () => undefined;

function toggle(name: string, shown: boolean): void {
  const group = groups[name]!;
  group.shown = shown;
  for (const layer of group.layers) {
    if (map?.getLayer(layer)) map.setLayoutProperty(layer, "visibility", shown ? "visible" : "none");
  }
  refreshFire();
}

const alarms = new Alarms(store);
topBar(store, alarms, showHelp);
timeBar(store);
replayBar(store);
const toolbar = new Toolbar(store, () => pens);
const fire = new FirePanel(store, groups, toggle);
side(store, [
  { key: "vehicles", words: "Vehicles", element: new VehiclesPanel(store).element, there: () => true },
  { key: "burn", words: "Burn", element: new BurnPanel(store).element, there: () => Boolean(store.state?.burn) },
  { key: "fire", words: "Fire", element: fire.element, there: () => true },
  {
    key: "planner",
    words: "Planner",
    element: new PlannerPanel(store).element,
    there: () => true,
  },
  { key: "log", words: "Log", element: logPanel(store), there: () => true },
]);
shortcut("?", "Show this list of keys", showHelp);
shortcut("c", "Centre the map on the chosen vehicle", () => {
  const here = store.telemetry.get(store.chosen);
  if (here) map?.panTo([here.lon_deg, here.lat_deg]);
});
listenForKeys();
acceptFiles();

/** The map is made once the first picture says where it is. */
async function makeMapOnce(): Promise<void> {
  if (!store.state || map) return;
  const { landscape } = store.state;
  const made = await makeMap(byId("map"), landscape, (await firstView()) ?? landscape.bounds, [
    fireLayers,
    burnLayers,
    vehicleLayers,
  ]);
  map = made;
  pens = new Pens(made, (stroke) => void toolbar.send(stroke), (words) => {
    byId("aloud").textContent = words;
  });
  refreshFire = followFire(made, store, (group) => groups[group]?.shown ?? false, (scale) => fire.showScale(scale)).refresh;
  followVehicles(made, store);
  followBurn(made, store);
  store.changed("all");
  Object.assign(window, { missionMap: made }); // for the console, and for tests
  byId("map").dataset.ready = "yes";
  await fetchTracks(store);
  setInterval(() => {
    if (store.missed) void fetchTracks(store);
  }, store.state.replay ? TRACKS_OF_REPLAY_MS : TRACKS_AGAIN_MS);
  let jumps = store.state.replay?.jumps;
  store.on(["replay"], () => {
    if (store.state?.replay?.jumps === jumps) return;
    jumps = store.state?.replay?.jumps;
    void fetchTracks(store);
  });
}

/** Where fire, vehicles and burn unit are. */
async function firstView(): Promise<[number, number, number, number] | null> {
  const MIN_M = 500;
  const front = await get<GeoJSON.GeoJSON>("fire/front").catch(() => null);
  const unit = (store.state?.burn?.guidance.unit ?? []).flat().map(([lat, lon]): LonLat => [lon, lat]);
  const vehicles = [...store.telemetry.values()].map((here): LonLat => [here.lon_deg, here.lat_deg]);
  return around([...(front ? placesOf(front) : []), ...unit, ...vehicles], MIN_M);
}

let making = false;
store.on([], () => {
  if (making) return;
  making = true;
  void makeMapOnce().catch((error: unknown) => {
    console.error("cannot display the map", error);
    byId("map").textContent = `Cannot display the map: ${String(error)}`;
  });
});

function acceptFiles(): void {
  const place = byId("map");
  place.addEventListener("dragover", (event) => event.preventDefault());
  place.addEventListener("drop", (event) => {
    event.preventDefault();
    void fire.upload(event.dataTransfer?.files[0]);
  });
}

function enter(): void {
  void store.follow();
}

takeToken();
whenUnauthorised(() => askForToken("This token is not valid, or no longer valid.", enter));
if (token()) enter();
else askForToken("This map needs a token.", enter);
