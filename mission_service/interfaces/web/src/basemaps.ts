// Basemaps below the fire: files of map tiles from the service, and contour and drainage lines from the elevation.
// Three styles select what is drawn: topo (vector tiles, relief lines, hillshade), imagery (raster tiles), hillshade.

import { type Flavor, layers as protomaps, namedFlavor } from "@protomaps/basemaps";
import {
  addProtocol, type ExpressionSpecification, type GeoJSONSource, type LayerSpecification, type Map as MapView, type SourceSpecification,
} from "maplibre-gl";
import { FetchSource, PMTiles, Protocol } from "pmtiles";
import { BASE, get, headers } from "./api.ts";
import { collection, FONT, type Group, labelLayer, lineLayer } from "./map.ts";
import { shownLanguage, t } from "./messages.ts";
import { type Basemap as Style, chosenBasemap, onPreferences, shownTheme } from "./preferences.ts";
import { length } from "./units.ts";

interface Basemap {
  name: string;
  kind: "vector" | "raster";
  storage: "pmtiles" | "tiles";
  min_zoom: number;
  max_zoom: number;
  bounds: [number, number, number, number];
  attribution: string;
  layers: string[];
}

const FLAVORS = { day: "light", night: "dark", contrast: "white" } as const; // of protomaps
const OF_PROTOMAPS = ["earth", "roads"]; // layers that only this schema has together
const FIRST_OF_FIRE = "uncertainty";

export const RELIEF_GROUPS: Record<string, Group> = {
  relief: { label: t("Contour lines, streams"), layers: ["relief-contours", "relief-drainage", "relief-heights"], shown: true },
};

/** The styles for which there is something to show. */
let offered: Style[] = ["hillshade"];
export const offeredBasemaps = (): readonly Style[] => offered;

/** Add the basemaps of the service; `toggle` shows and hides groups of layers, `themed` colours new layers. */
export async function addBasemaps(
  map: MapView, hasRelief: boolean, toggle: (group: string, shown: boolean) => void, themed: () => void,
): Promise<void> {
  const files = await get<Basemap[]>("basemaps").catch((): Basemap[] => []);
  const protocol = new Protocol();
  addProtocol("pmtiles", protocol.tile);
  const aboveGround = map.getLayer("hillshade") ? "hillshade" : FIRST_OF_FIRE;
  let own: string[] = []; // layers of files
  for (const file of files) map.addSource(sourceOf(file), specificationOf(file, protocol));
  if (hasRelief) addRelief(map);
  offered = [
    ...(hasRelief || files.some(({ kind }) => kind === "vector") ? (["topo"] as const) : []),
    ...(files.some(({ kind }) => kind === "raster") ? (["imagery"] as const) : []),
    "hillshade",
  ];
  let shown = "";
  const apply = (): void => {
    const style = offered.includes(chosenBasemap()) ? chosenBasemap() : offered[0]!;
    if (shown === `${style} ${shownTheme()}`) return;
    if (!shown.startsWith(`${style} `)) {
      toggle("hillshade", style !== "imagery");
      toggle("relief", style === "topo");
    }
    shown = `${style} ${shownTheme()}`;
    for (const layer of own) map.removeLayer(layer);
    const layers = files.flatMap((file) => layersOf(file, style));
    for (const layer of layers) map.addLayer(layer, layer.type === "symbol" ? FIRST_OF_FIRE : aboveGround);
    own = layers.map(({ id }) => id);
    themed();
  };
  onPreferences(apply);
  apply();
}

const sourceOf = ({ name }: Basemap): string => `basemap-${name}`;

function specificationOf(file: Basemap, protocol: Protocol): SourceSpecification {
  const common = {
    minzoom: file.min_zoom, maxzoom: file.max_zoom, bounds: file.bounds, attribution: plainText(file.attribution),
  };
  const path = `${BASE}basemaps/${encodeURIComponent(file.name)}`;
  if (file.storage === "tiles") {
    return { type: file.kind, tiles: [`${path}/{z}/{x}/{y}`], ...(file.kind === "raster" && { tileSize: 256 }), ...common };
  }
  const url = `${path}/archive`;
  protocol.add(new PMTiles(new FetchSource(url, new Headers(headers()))));
  return { type: file.kind, tiles: [`pmtiles://${url}/{z}/{x}/{y}`], ...(file.kind === "raster" && { tileSize: 256 }), ...common };
}

/** A text of a file without markup, which the map would otherwise interpret. */
const plainText = (markup: string): string =>
  new DOMParser().parseFromString(markup, "text/html").body.textContent?.replaceAll(/[<>&]/g, "") ?? "";

/** The layers of a file in a style; none if the style does not show the file. */
function layersOf(file: Basemap, style: Style): LayerSpecification[] {
  const source = sourceOf(file);
  if (file.kind === "raster") {
    return style === "imagery" ? [{ id: `${source}/image`, type: "raster", source, paint: { "raster-fade-duration": 0 } }] : [];
  }
  if (style === "hillshade") return [];
  const ofProtomaps = OF_PROTOMAPS.every((name) => file.layers.includes(name));
  const found = ofProtomaps ? layersOfProtomaps(source) : file.layers.flatMap((name) => layersByName(source, name));
  const isOverImage = style === "imagery"; // only names and lines of roads are useful on an image
  return found
    .filter(({ type, id }) => !isOverImage || type === "symbol" || (type === "line" && /road|transport/i.test(id)))
    .map((layer) => ({ ...layer, id: `${source}/${layer.id}` }) as LayerSpecification);
}

/** The layers of tiles with the schema of Protomaps, with fonts of the system and without icons. */
function layersOfProtomaps(source: string): LayerSpecification[] {
  const flavor: Flavor = namedFlavor(FLAVORS[shownTheme()]);
  return protomaps(source, flavor, { lang: shownLanguage() })
    .filter(({ type }) => type !== "background")
    .map((layer) => {
      if (layer.type !== "symbol") return layer as LayerSpecification;
      const { "icon-image": _, ...layout } = layer.layout ?? {};
      return { ...layer, layout: { ...layout, ...FONT } } as LayerSpecification;
    });
}

/** The layers of a layer of vector tiles with another schema, by its name. */
function layersByName(source: string, name: string): LayerSpecification[] {
  const isNight = shownTheme() === "night";
  const [water, road, area, grey] = isNight
    ? ["#1d4a66", "#8d8471", "#24332a", "#59636d"]
    : ["#9cc8e3", "#a08a68", "#d5e3c8", "#8b949b"];
  const of = { source, "source-layer": name };
  const fill = (colour: string): LayerSpecification =>
    ({ ...of, id: `${name}-area`, type: "fill", paint: { "fill-color": colour }, filter: ["==", ["geometry-type"], "Polygon"] });
  const line = (colour: string, width: number): LayerSpecification => ({
    ...of, id: `${name}-line`, type: "line", paint: { "line-color": colour, "line-width": width },
    filter: ["==", ["geometry-type"], "LineString"],
  });
  const label = { ...labelLayer(`${name}-name`, source, "#333", { "text-field": ["coalesce", ["get", `name:${shownLanguage()}`], ["get", "name"], ""], "text-size": 13 }), ...of } as LayerSpecification;
  if (/water|ocean|lake|river|stream/i.test(name)) return [fill(water!), line(water!, 1.5)];
  if (/land|park|wood|forest|veget/i.test(name)) return [fill(area!)];
  if (/transport|road|street|highway|trail/i.test(name)) return [line(road!, 2)];
  if (/place|poi|peak|label|name/i.test(name)) return [label];
  if (/building/i.test(name)) return [fill(grey!)];
  return [line(grey!, 1)];
}

/** Add contour and drainage lines; the data are read when the style is first shown. */
function addRelief(map: MapView): void {
  map.addSource("relief", { type: "geojson", data: collection() });
  const isKind = (kind: string): ExpressionSpecification => ["==", ["get", "kind"], kind];
  const lines = [
    lineLayer("relief-contours", "relief", {
      "line-color": "#8a6a44", "line-opacity": 0.65, "line-width": ["case", ["get", "index"], 1.3, 0.6],
    }, { filter: isKind("contour") }),
    lineLayer("relief-drainage", "relief", {
      "line-color": "#2a76b0", "line-width": ["interpolate", ["linear"], ["get", "drained_ha"], 25, 1, 2000, 3.5],
    }, { filter: isKind("drainage") }),
    labelLayer("relief-heights", "relief", "#5f4526", {
      "symbol-placement": "line", "text-field": ["get", "label"], "text-size": 12, "symbol-spacing": 350,
    }, { minzoom: 12, filter: ["all", isKind("contour"), ["get", "index"]] }),
  ];
  for (const layer of lines) map.addLayer(layer, FIRST_OF_FIRE);
  void get<GeoJSON.FeatureCollection>("relief.geojson").then((relief) => {
    const label = (): void => {
      for (const { properties } of relief.features) {
        if (properties?.kind === "contour") properties.label = length(properties.height_m as number);
      }
      (map.getSource("relief") as GeoJSONSource).setData(relief);
    };
    onPreferences(label);
    label();
  }).catch((error: unknown) => console.warn("no relief lines", error));
}
