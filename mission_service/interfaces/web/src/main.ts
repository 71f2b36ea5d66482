// Creates all parts of the page; each part shows the state in one store.

import "./base.css";
import "./style.css";
import type { Map as MapView } from "maplibre-gl";
import { AIRCRAFT_GROUPS, aircraftLayers, followAircraft } from "./aircraft_layer.ts";
import { Alarms } from "./alarms.ts";
import { get, whenUnauthorised } from "./api.ts";
import { ARRIVAL_GROUPS, arrivalLayers, followArrivals } from "./arrival_layer.ts";
import { AIRSPACE_GROUPS, airspaceLayers, followAirspace } from "./airspace_layer.ts";
import { addBasemaps, RELIEF_GROUPS } from "./basemaps.ts";
import { BURN_GROUPS, burnLayers, followBurn } from "./burn_layer.ts";
import { clearingPanel } from "./clearing.ts";
import { showDisplay } from "./display_dialog.ts";
import { askForToken, showHelp } from "./dialogs.ts";
import { byId } from "./dom.ts";
import { FIRE_GROUPS, fireLayers, followFire } from "./fire_layer.ts";
import { extentOf, pointsOf } from "./geo.ts";
import { followImages, IMAGE_GROUPS, imageLayers } from "./image_layer.ts";
import { listenForKeys, shortcut } from "./keys.ts";
import { type Group, makeMap } from "./map.ts";
import { MapButtons } from "./map_buttons.ts";
import { followTheme } from "./map_theme.ts";
import { followMeasured, measureLayers } from "./measure_layer.ts";
import { t, translateDocument } from "./messages.ts";
import { followNotes, NOTE_GROUPS, noteLayers } from "./notes_layer.ts";
import { followObservations, OBSERVATION_GROUPS, observationLayers } from "./observation_layer.ts";
import { BurnPanel } from "./panels/burn.ts";
import { FirePanel } from "./panels/fire.ts";
import { logPanel } from "./panels/log.ts";
import { PlannerPanel } from "./panels/planner.ts";
import { SensorsPanel } from "./panels/sensors.ts";
import { VehiclesPanel } from "./panels/vehicles.ts";
import { Pens } from "./pens.ts";
import { onPreferences } from "./preferences.ts";
import { replayBar } from "./replay_bar.ts";
import { followRings, RING_GROUPS, ringLayers } from "./rings_layer.ts";
import { side } from "./side.ts";
import { sortiesPanel } from "./sorties.ts";
import { Store } from "./store.ts";
import { timeBar } from "./time_bar.ts";
import { takeToken, token } from "./token.ts";
import { Toolbar } from "./toolbar.ts";
import { topBar } from "./top_bar.ts";
import { isTourDue, showTour } from "./tour.ts";
import type { LonLat } from "./types.ts";
import { waitingButton } from "./waiting.ts";
import { fetchTracks, followVehicles, VEHICLE_GROUPS, vehicleLayers } from "./vehicles_layer.ts";

const groups: Record<string, Group> = {
  ...FIRE_GROUPS, ...OBSERVATION_GROUPS, ...IMAGE_GROUPS, ...VEHICLE_GROUPS, ...AIRCRAFT_GROUPS,
  ...ARRIVAL_GROUPS, ...BURN_GROUPS, ...AIRSPACE_GROUPS, ...NOTE_GROUPS, ...RING_GROUPS,
  ...RELIEF_GROUPS,
};
translateDocument();
const store = new Store();
const TRACKS_AGAIN_MS = 10_000;
const TRACKS_OF_REPLAY_MS = 2000; // a replay may run at a hundred times real time
let map: MapView | null = null;
let pens: Pens | null = null;
let refreshLayers: (() => void)[] = [];

function toggle(name: string, shown: boolean): void {
  const group = groups[name]!;
  group.shown = shown;
  for (const layer of group.layers) {
    if (map?.getLayer(layer)) map.setLayoutProperty(layer, "visibility", shown ? "visible" : "none");
  }
  for (const box of document.querySelectorAll<HTMLInputElement>(`[data-layers="${name}"]`)) box.checked = shown;
  for (const refresh of refreshLayers) refresh();
}

const alarms = new Alarms(store);
const waiting = waitingButton(store, alarms, (panel) => openPanel(panel));
topBar(store, alarms, waiting, showHelp);
clearingPanel(store);
sortiesPanel(store);
timeBar(store);
replayBar(store);
const toolbar = new Toolbar(store, () => pens);
const fire = new FirePanel(store, groups, toggle);
const openPanel = side(store, [
  { key: "vehicles", label: t("Vehicles"), element: new VehiclesPanel(store).element, available: () => true },
  { key: "burn", label: t("Burn"), element: new BurnPanel(store).element, available: () => Boolean(store.state?.burn) },
  { key: "fire", label: t("Fire"), element: fire.element, available: () => true },
  { key: "sensors", label: t("Sensors"), element: new SensorsPanel(store, groups, toggle).element, available: () => true },
  { key: "planner", label: t("Planner"), element: new PlannerPanel(store).element, available: () => true },
  { key: "log", label: t("Log"), element: logPanel(store), available: () => true },
]);
shortcut("?", t("Show this list of keys"), showHelp);
shortcut("c", t("Centre the map on the chosen vehicle"), () => {
  const fix = store.telemetry.get(store.chosen);
  if (fix) map?.panTo([fix.lon_deg, fix.lat_deg]);
});
onPreferences(() => store.changed("all"));
listenForKeys();
acceptFiles();

/** Create the map when the first state with the landscape has arrived. */
async function makeMapOnce(): Promise<void> {
  if (!store.state || map) return;
  const { landscape } = store.state;
  const made = await makeMap(byId("map"), landscape, (await firstView()) ?? landscape.bounds, [
    fireLayers,
    observationLayers,
    imageLayers,
    airspaceLayers,
    burnLayers,
    ringLayers,
    noteLayers,
    arrivalLayers,
    aircraftLayers,
    vehicleLayers,
    measureLayers,
  ]);
  made.addControl(new MapButtons(store, showDisplay), "top-right");
  map = made;
  const themed = followTheme(made);
  pens = new Pens(made, (stroke) => void toolbar.send(stroke), (text) => {
    byId("announcer").textContent = text;
  });
  const shown = (group: string): boolean => groups[group]?.shown ?? false;
  refreshLayers = [
    followFire(made, store, shown, (scale) => fire.showScale(scale)).refresh,
    followObservations(made, store, shown),
    followImages(made, store),
    followRings(made, store, () => shown("rings")),
  ];
  followVehicles(made, store);
  followAircraft(made, store);
  followBurn(made, store);
  followAirspace(made, store);
  followMeasured(made, store);
  followNotes(made, store);
  followArrivals(made, store);
  store.changed("all");
  Object.assign(window, { missionMap: made }); // for the console, and for tests
  await addBasemaps(made, Boolean(made.getLayer("hillshade")), toggle, themed);
  byId("map").dataset.ready = "yes";
  if (isTourDue()) showTour();
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

/** Return the extent of fire, vehicles and burn unit. */
async function firstView(): Promise<[number, number, number, number] | null> {
  const MIN_M = 500;
  const front = await get<GeoJSON.GeoJSON>("fire/front").catch(() => null);
  const unit = (store.state?.burn?.guidance.unit ?? []).flat().map(([lat, lon]): LonLat => [lon, lat]);
  const vehicles = [...store.telemetry.values()].map((fix): LonLat => [fix.lon_deg, fix.lat_deg]);
  return extentOf([...(front ? pointsOf(front) : []), ...unit, ...vehicles], MIN_M);
}

let making = false;
store.on([], () => {
  if (making) return;
  making = true;
  void makeMapOnce().catch((error: unknown) => {
    console.error("cannot display the map", error);
    byId("map").textContent = t("Cannot display the map: {error}", { error: String(error) });
  });
});

function acceptFiles(): void {
  const target = byId("map");
  target.addEventListener("dragover", (event) => event.preventDefault());
  target.addEventListener("drop", (event) => {
    event.preventDefault();
    void fire.upload(event.dataTransfer?.files[0]);
  });
}

const enter = (): void => void store.follow();

takeToken();
whenUnauthorised(() => askForToken(t("This token is not valid."), enter));
if (token()) enter();
else askForToken(t("This map requires a token."), enter);
