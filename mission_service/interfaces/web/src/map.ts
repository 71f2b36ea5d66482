// The map: terrain of the service, then layers from bottom to top. Other modules only set the data
// of sources. Labels use fonts of the system; the page loads no resource from another host.

import "maplibre-gl/dist/maplibre-gl.css";
import {
  AttributionControl,
  type CircleLayerSpecification,
  type ExpressionSpecification,
  type FillLayerSpecification,
  type GeoJSONSource,
  type LayerSpecification,
  type LineLayerSpecification,
  Map as MapView,
  NavigationControl,
  ScaleControl,
  setWorkerUrl,
  type SourceSpecification,
  type SymbolLayerSpecification,
} from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?worker&url";
import { BASE, get, headers } from "./api.ts";
import { CoordinatesControl } from "./coordinates.ts";
import { t } from "./messages.ts";
import { chosenUnits, onPreferences } from "./preferences.ts";
import type { Landscape } from "./types.ts";

setWorkerUrl(workerUrl);

const SCALES = { metric: "metric", us: "imperial", aviation: "nautical" } as const;

export interface Layers {
  sources: Record<string, SourceSpecification>;
  layers: LayerSpecification[];
}

/** Layers that one checkbox shows and hides. */
export interface Group {
  label: string;
  layers: string[];
  shown: boolean;
}

export function collection(features: GeoJSON.Feature[] = []): GeoJSON.FeatureCollection {
  return { type: "FeatureCollection", features };
}

export function feature(geometry: GeoJSON.Geometry, properties: Record<string, unknown> = {}): GeoJSON.Feature {
  return { type: "Feature", geometry, properties };
}

export const line = (coordinates: [number, number][]): GeoJSON.LineString => ({ type: "LineString", coordinates });
export const point = (coordinates: [number, number]): GeoJSON.Point => ({ type: "Point", coordinates });

/** A source without data. */
export const empty = (): SourceSpecification => ({ type: "geojson", data: collection() });

/** Fonts of the system: without a glyph server MapLibre renders all letters locally. */
export const FONT = { "text-font": ["sans-serif"] };

type More = Pick<LineLayerSpecification, "filter" | "minzoom"> & { layout?: { visibility: "none" } };

export const fillLayer = (id: string, source: string, paint: FillLayerSpecification["paint"], more: More = {}) =>
  ({ id, type: "fill", source, paint, ...more }) as LayerSpecification;
export const lineLayer = (id: string, source: string, paint: LineLayerSpecification["paint"], more: More = {}) =>
  ({ id, type: "line", source, paint, ...more }) as LayerSpecification;
export const circleLayer = (id: string, source: string, paint: CircleLayerSpecification["paint"], more: More = {}) =>
  ({ id, type: "circle", source, paint, ...more }) as LayerSpecification;

/** A layer of texts with a white halo. */
export const labelLayer = (
  id: string, source: string, colour: string, text: SymbolLayerSpecification["layout"], more: More = {},
): LayerSpecification => ({
  id,
  type: "symbol",
  source,
  layout: { ...FONT, ...text },
  paint: { "text-color": colour, "text-halo-color": "#fff", "text-halo-width": 2 },
  ...(more as Omit<More, "layout">),
});

/** A layer of turned icons, which are always drawn, with labels where there is room; data have `icon` and `label`. */
export const iconLayer = (
  id: string,
  turn: string, // the property with the direction in degrees
  more: SymbolLayerSpecification["layout"],
  colour: string | ExpressionSpecification,
): LayerSpecification => ({
  id,
  type: "symbol",
  source: id,
  layout: {
    ...FONT,
    "icon-image": ["get", "icon"],
    "icon-rotate": ["get", turn],
    "icon-rotation-alignment": "map",
    "icon-allow-overlap": true,
    "icon-ignore-placement": true,
    "text-field": ["get", "label"],
    "text-justify": "auto",
    "text-variable-anchor": ["left", "right", "top", "bottom"],
    "text-optional": true,
    "text-max-width": 30,
    ...more,
  },
  paint: { "text-color": colour, "text-halo-color": "#fff", "text-halo-width": 2.5 },
});

export function show(map: MapView, source: string, data: GeoJSON.GeoJSON): void {
  const found = map.getSource(source) as GeoJSONSource | undefined;
  const text = JSON.stringify(data);
  if (!found || shown.get(found) === text) return; // the map would draw the same again
  shown.set(found, text);
  found.setData(data);
}

const shown = new WeakMap<GeoJSONSource, string>();

interface TileJson {
  tiles?: string[];
  minzoom?: number;
  maxzoom?: number;
  bounds?: [number, number, number, number];
  tileSize?: number;
}

/** Create the map in `container`; resolves when sources accept data. */
export async function makeMap(
  container: HTMLElement,
  landscape: Landscape,
  view: [number, number, number, number],
  parts: Layers[],
): Promise<MapView> {
  const terrain = await get<TileJson>("terrain.json").catch(() => null);
  const ground = terrain?.tiles?.length ? groundOf(terrain, landscape) : { sources: {}, layers: [] };
  const all = [ground, ...parts];
  const map = new MapView({
    container,
    bounds: view,
    fitBoundsOptions: { padding: 30 },
    attributionControl: false,
    locale: {
      "NavigationControl.ZoomIn": t("Zoom in"),
      "NavigationControl.ZoomOut": t("Zoom out"),
      "AttributionControl.ToggleAttribution": t("Show or hide the sources of the map"),
      "Map.Title": t("Map"),
    },
    dragRotate: false,
    pitchWithRotate: false,
    maxPitch: 0,
    maxZoom: 19,
    fadeDuration: 0,
    transformRequest: (url) => (url.startsWith(BASE) ? { url, headers: headers() } : { url }),
    style: {
      version: 8,
      sources: Object.assign({}, ...all.map((part) => part.sources)),
      layers: [
        { id: "paper", type: "background", paint: { "background-color": "#efece3" } },
        ...all.flatMap((part) => part.layers),
      ],
    },
  });
  map.touchZoomRotate.disableRotation();
  map.keyboard.disableRotation();
  map.addControl(new NavigationControl({ showCompass: false }), "top-right");
  const scale = new ScaleControl({ unit: SCALES[chosenUnits()] });
  map.addControl(scale, "bottom-left");
  onPreferences(() => scale.setUnit(SCALES[chosenUnits()]));
  map.addControl(new CoordinatesControl(), "bottom-left");
  map.addControl(new AttributionControl({ compact: true, customAttribution: "MapLibre" }));
  map.getCanvas().setAttribute("aria-label", t("Map: arrow keys move it, + and − zoom"));
  await map.once("style.load");
  return map;
}

function groundOf(terrain: TileJson, landscape: Landscape): Layers {
  return {
    sources: {
      terrain: {
        type: "raster-dem",
        encoding: "terrarium",
        tiles: [`${BASE}terrain/{z}/{x}/{y}.png`],
        tileSize: terrain.tileSize ?? 256,
        minzoom: terrain.minzoom ?? 8,
        maxzoom: terrain.maxzoom ?? 15,
        bounds: terrain.bounds ?? landscape.bounds,
      },
    },
    layers: [
      {
        id: "hillshade",
        type: "hillshade",
        source: "terrain",
        paint: {
          "hillshade-exaggeration": 0.5,
          "hillshade-shadow-color": "#5b5348",
          "hillshade-highlight-color": "#ffffff",
          "hillshade-accent-color": "#8a8170",
        },
      },
    ],
  };
}
