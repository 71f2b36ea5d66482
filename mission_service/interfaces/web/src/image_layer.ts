// Images of sensors on the terrain: the newest on top, older ones fainter. The selected image is above
// the others, with the ellipse that contains its true place with a probability of 90 %, and a label.

import type { Map as MapView } from "maplibre-gl";
import { ask, get } from "./api.ts";
import { coalesced } from "./coalesce.ts";
import { ellipse } from "./geo.ts";
import { collection, empty, feature, type Group, labelLayer, type Layers, line, lineLayer, point, show } from "./map.ts";
import { t } from "./messages.ts";
import { imageKey, type Store } from "./store.ts";
import type { LonLat, MapImage } from "./types.ts";
import { accuracy, counter } from "./units.ts";

const EVERY_MS = 2000;
const [OPACITY, FAINTER, FAINTEST] = [0.95, 0.07, 0.3]; // of the newest; less for each newer one; at least
const SIGMAS = 2.146; // semi-axes of the ellipse of 90 %, in standard deviations
const BELOW = "front-now-line"; // the layer above the images
const HIDDEN = { visibility: "none" } as const; // until its box is checked
const ELLIPSE = { filter: ["==", ["geometry-type"], "LineString"] as never, layout: HIDDEN };

export const imageLayers: Layers = {
  sources: { "image-place": empty() },
  layers: [
    lineLayer("image-ellipse-halo", "image-place", { "line-color": "#000000", "line-width": 5 }, ELLIPSE),
    lineLayer("image-ellipse", "image-place", { "line-color": "#00e5ff", "line-width": 2.5 }, ELLIPSE),
    labelLayer("image-label", "image-place", "#000", {
      ...HIDDEN,
      "text-field": ["get", "label"],
      "text-size": 14,
      "text-justify": "auto",
      "text-variable-anchor": ["top", "bottom", "left", "right"],
      "text-radial-offset": 1.6,
      "text-allow-overlap": true,
      "text-max-width": 30,
    }, { filter: ["==", ["geometry-type"], "Point"] as never }),
  ],
};

const group: Group = { label: t("Images of sensors"), layers: imageLayers.layers.map(({ id }) => id), shown: false };
export const IMAGE_GROUPS: Record<string, Group> = { images: group };

/** Semi-axes of the ellipse that contains the true place with a probability of 90 %, in metres. */
export const axesOf = ({ major_m, minor_m }: MapImage): [number, number] => [SIGMAS * major_m, SIGMAS * minor_m];

/** Keep the images up to date; return a function that updates them now. */
export function followImages(map: MapView, store: Store): () => void {
  let drawn: string[] = [];
  let chosen = "";

  const refresh = coalesced(async () => {
    if (!store.state?.sources.some(({ kind }) => kind === "sensor")) return store.setImages([]);
    store.setImages(await get<MapImage[]>("fire/images"));
  }, EVERY_MS);

  const draw = coalesced(async () => {
    if (!group.shown) return;
    const names = store.images.map(layerOf);
    for (const old of drawn.filter((name) => !names.includes(name))) remove(map, old);
    for (const image of store.images) {
      if (!map.getLayer(layerOf(image))) await add(map, image).catch(() => undefined); // it is gone
    }
    drawn = names.filter((name) => map.getLayer(name));
    renew();
  }, 0);

  const renew = (): void => {
    const { images, image: selected } = store;
    for (const [place, each] of images.entries()) {
      const name = layerOf(each);
      if (!map.getLayer(name)) continue;
      const fainter = Math.max(FAINTEST, OPACITY - FAINTER * (images.length - 1 - place));
      map.setPaintProperty(name, "raster-opacity", each === selected ? OPACITY : fainter);
      map.moveLayer(name, BELOW);
    }
    if (selected && map.getLayer(layerOf(selected))) map.moveLayer(layerOf(selected), BELOW);
    show(map, "image-place", collection(selected ? placeOf(selected, sourceOf(selected, store)) : []));
    const key = store.imageKey;
    if (selected && key && key !== chosen && !map.getBounds().contains(middleOf(selected))) {
      map.panTo(middleOf(selected));
    }
    chosen = key;
  };

  store.on(["sources"], refresh);
  store.on(["images"], () => {
    renew();
    draw();
  });
  map.on("click", ({ lngLat: { lng, lat } }) => {
    if (!group.shown) return;
    const under = store.images.filter((each) => isOn(each, [lng, lat])).reverse();
    const next = under[under.indexOf(store.image!) + 1] ?? under[0]; // the one below the selected one
    if (next) store.selectImage(imageKey(next));
  });
  return () => {
    refresh();
    draw();
  };
}

/** The name of the layer of an image; a service that has started again has other times. */
const layerOf = (image: MapImage): string => `image ${imageKey(image)} ${image.at_us}`;
const middleOf = ({ lon_deg, lat_deg }: MapImage): LonLat => [lon_deg, lat_deg];

function isOn({ corners: [[west, north], , [east, south]] }: MapImage, [lon, lat]: LonLat): boolean {
  return west <= lon && lon <= east && south <= lat && lat <= north;
}

/** Request the picture of an image, and add its layer. */
async function add(map: MapView, image: MapImage): Promise<void> {
  const response = await ask(`fire/images/${encodeURIComponent(image.source)}/${image.number}.png`);
  const picture = await createImageBitmap(await response.blob());
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [picture.width, picture.height];
  canvas.getContext("2d")!.drawImage(picture, 0, 0);
  picture.close();
  const name = layerOf(image);
  map.addSource(name, { type: "canvas", canvas, coordinates: image.corners, animate: false });
  map.addLayer({
    id: name,
    type: "raster",
    source: name,
    layout: { visibility: group.shown ? "visible" : "none" },
    paint: { "raster-fade-duration": 0 },
  }, BELOW);
  group.layers.push(name);
}

function remove(map: MapView, name: string): void {
  map.removeLayer(name);
  map.removeSource(name);
  group.layers = group.layers.filter((each) => each !== name);
}

/** The sensor of an image, and its vehicle if there is only one: images do not contain their vehicle. */
export const sourceOf = ({ source, vehicle }: MapImage, store: Store): string =>
  store.vehicles.size === 1 ? `${source}, ${vehicle}` : source;

/** The ellipse and the label of an image. */
function placeOf(image: MapImage, source: string): GeoJSON.Feature[] {
  const label = `${counter(image.at_us / 1e6)} ${source}\n${accuracy(image.position_sd_m)}`;
  return [
    feature(line(ellipse(middleOf(image), ...axesOf(image), image.major_from_deg))),
    feature(point(middleOf(image)), { label }),
  ];
}
