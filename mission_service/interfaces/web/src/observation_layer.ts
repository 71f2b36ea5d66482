// Observations: what each source has seen in the last minutes, in the colour of the source.

import type { ExpressionSpecification, Map as MapView } from "maplibre-gl";
import { get } from "./api.ts";
import { coalesced } from "./coalesce.ts";
import { circleLayer, collection, empty, feature, fillLayer, type Group, type Layers, lineLayer, show } from "./map.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";
import type { Observation } from "./types.ts";

const FADE_S = 120; // an observation becomes fainter until this age, in mission time
const MAX_SHOWN = 64; // the latest observations of all sources
const EVERY_MS = 2000;
// Different from the reds and oranges of the fire, and from each other.
const COLOURS = ["#0057b8", "#6a1b9a", "#00695c", "#ad1457", "#37474f", "#827717", "#0086a8", "#3f51b5"];
const HIDDEN = { layout: { visibility: "none" } } as const; // until its box is checked
const COLOUR: ExpressionSpecification = ["get", "colour"];

/** Opacities that fall with the age of an observation: of the latest of a source, and of earlier ones. */
const faded = (latest: number, earlier: number): ExpressionSpecification =>
  ["*", ["case", ["get", "latest"], latest, earlier], ["get", "fade"]];
const WIDTH: ExpressionSpecification = ["case", ["get", "latest"], 3, 1];
const part = (name: string, ...more: unknown[]) => ({ filter: ["all", ["==", ["get", "part"], name], ...more] as never });
const shape = (name: string) => ["in", ["geometry-type"], ["literal", [name, `Multi${name}`]]];

export const observationLayers: Layers = {
  sources: { observations: empty() },
  layers: [
    fillLayer("observed-area", "observations", { "fill-color": COLOUR, "fill-opacity": faded(0.12, 0.04) },
      { ...part("seen"), ...HIDDEN }),
    fillLayer("observed-burned", "observations", { "fill-color": COLOUR, "fill-opacity": faded(0.4, 0.12) },
      { ...part("burned"), ...HIDDEN }),
    lineLayer("observed-outline", "observations", { "line-color": COLOUR, "line-width": WIDTH, "line-opacity": faded(1, 0.5) },
      { ...part("seen", ["!", ["get", "distrusted"]]), ...HIDDEN }),
    lineLayer("observed-not-used", "observations", {
      "line-color": COLOUR, "line-width": WIDTH, "line-opacity": faded(1, 0.5), "line-dasharray": [2, 2],
    }, { ...part("seen", ["get", "distrusted"]), ...HIDDEN }),
    fillLayer("reported-area", "observations", { "fill-color": COLOUR, "fill-opacity": faded(0.25, 0.25) },
      { ...part("reported", shape("Polygon")), ...HIDDEN }),
    lineLayer("reported-line", "observations", { "line-color": COLOUR, "line-width": 4, "line-opacity": faded(1, 1) },
      { ...part("reported", ["!", shape("Point")]), ...HIDDEN }),
    circleLayer("reported-point", "observations", {
      "circle-color": ["case", ["==", ["get", "state"], "unburned"], "#ffffff", COLOUR],
      "circle-radius": 7,
      "circle-stroke-color": ["case", ["==", ["get", "state"], "unburned"], COLOUR, "#ffffff"],
      "circle-stroke-width": 3,
      "circle-opacity": faded(1, 1),
      "circle-stroke-opacity": faded(1, 1),
    }, { ...part("reported", shape("Point")), ...HIDDEN }),
  ],
};

export const OBSERVATION_GROUPS: Record<string, Group> = {
  observations: { label: t("Observations"), layers: observationLayers.layers.map(({ id }) => id), shown: false },
};

const colours = new Map<string, string>();

/** The colour of a source; it stays the same while the page is open. */
export function colourOf(source: string): string {
  const colour = colours.get(source) ?? COLOURS[colours.size % COLOURS.length]!;
  colours.set(source, colour);
  return colour;
}

type Seen = GeoJSON.Feature<GeoJSON.Geometry, Observation>;

/** Keep the observations up to date while they are shown; return a function that updates them now. */
export function followObservations(map: MapView, store: Store, shown: (group: string) => boolean): () => void {
  let features: Seen[] = [];
  let state = store.state;
  const refresh = coalesced(async () => {
    if (!shown("observations")) return;
    if (state !== store.state) [state, features] = [store.state, []]; // another time, or a restart
    const last = features.at(-1)?.properties.number ?? 0;
    const found = await get<GeoJSON.FeatureCollection>(`fire/observations?after=${last}`);
    if (state !== store.state) return refresh();
    features = recent([...features, ...(found.features as Seen[])], store.nowS);
    const latest = new Map(features.map(({ properties: { source, number } }) => [source, number]));
    show(map, "observations", collection(features.map((each) => drawn(each, latest, store.nowS))));
  }, EVERY_MS);
  store.on(["sources", "telemetry"], refresh);
  return refresh;
}

const ageS = (seen: Seen, nowS: number): number => nowS - seen.properties.at_us / 1e6;

/** The latest observations, and always the last one received, from which the next request continues. */
function recent(features: Seen[], nowS: number): Seen[] {
  const last = features.at(-1)?.properties.number;
  const young = features.filter((each) => each.properties.number === last || ageS(each, nowS) < FADE_S);
  const numbers = [...new Set(young.map((each) => each.properties.number))].slice(-MAX_SHOWN);
  return young.filter((each) => each.properties.number >= numbers[0]!);
}

function drawn(seen: Seen, latest: Map<string, number>, nowS: number): GeoJSON.Feature {
  const { source, number } = seen.properties;
  const fade = Math.min(1, Math.max(0, 1 - ageS(seen, nowS) / FADE_S));
  return feature(seen.geometry, {
    ...seen.properties, colour: colourOf(source), fade, latest: latest.get(source) === number,
  });
}
