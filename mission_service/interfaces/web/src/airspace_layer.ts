// Closed volumes of airspace on the map, with their limits; volumes of a later time are paler. A click
// on a volume offers to open it.

import type { Map as MapView } from "maplibre-gl";
import { attempt, lacking, showMessage } from "./actions.ts";
import { post } from "./api.ts";
import { confirmed } from "./dialogs.ts";
import { collection, empty, feature, fillLayer, type Group, labelLayer, type Layers, lineLayer, show } from "./map.ts";
import { t } from "./messages.ts";
import { chosenUnits } from "./preferences.ts";
import type { Store } from "./store.ts";
import type { Volume } from "./types.ts";
import { clock, heightMsl } from "./units.ts";

const COLOUR = "#4a148c";

export const airspaceLayers: Layers = {
  sources: { airspace: empty() },
  layers: [
    fillLayer("airspace-area", "airspace", {
      "fill-color": COLOUR, "fill-opacity": ["case", ["get", "closed"], 0.22, 0.06],
    }),
    lineLayer("airspace-outline", "airspace", {
      "line-color": COLOUR, "line-width": ["case", ["get", "closed"], 3, 1.5], "line-dasharray": [3, 1],
    }),
    labelLayer("airspace-name", "airspace", COLOUR, { "text-field": ["get", "label"], "text-size": 14 }),
  ],
};

export const AIRSPACE_GROUPS: Record<string, Group> = {
  airspace: { label: t("Closed airspace"), layers: airspaceLayers.layers.map(({ id }) => id), shown: true },
};

export function followAirspace(map: MapView, store: Store): void {
  let shown = "";
  const update = (): void => {
    const volumes = (store.state?.airspace.volumes ?? []).filter((volume) => !isOver(volume, store.nowS * 1e6));
    const closed = volumes.map((volume) => isClosed(volume, store.nowS * 1e6));
    const key = JSON.stringify([chosenUnits(), volumes.map(({ name, from_us }) => [name, from_us]), closed]);
    if (key === shown) return;
    shown = key;
    show(map, "airspace", collection(volumes.map((volume, index) =>
      feature(volume.geometry, { name: volume.name, closed: closed[index], label: labelOf(volume, closed[index]!) }))));
  };
  store.on(["airspace", "telemetry", "status"], update);
  map.on("click", "airspace-area", ({ features, point }) => {
    const name = String(features?.[0]?.properties.name ?? "");
    if (name && !map.queryRenderedFeatures(point, { layers: ["vehicles"] }).length) void open(store, name);
  });
}

async function open(store: Store, name: string): Promise<void> {
  const reason = lacking(store, "fly");
  if (reason) return showMessage(reason, true);
  if (await confirmed(t("Open the airspace \"{name}\" to all vehicles again?", { name }))) {
    await attempt(t("Open airspace"), () => post("airspace/open", { name }));
  }
}

const isOver = ({ until_us }: Volume, atUs: number): boolean => until_us !== null && atUs >= until_us;
const isClosed = ({ from_us, until_us }: Volume, atUs: number): boolean =>
  from_us <= atUs && (until_us === null || atUs < until_us);

function labelOf(volume: Volume, closed: boolean): string {
  const floor = volume.floor_amsl_m === null ? t("ground") : heightMsl(volume.floor_amsl_m);
  const ceiling = volume.ceiling_amsl_m === null ? t("no upper limit") : heightMsl(volume.ceiling_amsl_m);
  const until = volume.until_us === null ? "" : t(" until {clock}", { clock: clock(volume.until_us / 1e6) });
  const when = closed ? t("closed{until}", { until }) : t("closed from {clock}{until}", { clock: clock(volume.from_us / 1e6), until });
  return t("{name}\n{floor} to {ceiling}\n{when}", { name: volume.name, floor, ceiling, when });
}
