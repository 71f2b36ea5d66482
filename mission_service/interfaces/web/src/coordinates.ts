// The coordinates under the pointer, or of the centre of the map on a touch screen; a press selects the next format.

import { forward as mgrs } from "mgrs";
import type { IControl, LngLat, Map as MapView } from "maplibre-gl";
import { h, setText } from "./dom.ts";
import { t } from "./messages.ts";

type Format = "degrees" | "minutes" | "mgrs";

const KEY = "mission-service-coordinates";
const TITLES: Record<Format, string> = {
  degrees: t("Decimal degrees, WGS 84"),
  minutes: t("Degrees and decimal minutes, WGS 84"),
  mgrs: t("MGRS, the same as USNG (WGS 84), to 1 m"),
};
const FORMATS = Object.keys(TITLES) as Format[];
const MGRS_LIMIT_DEG: [number, number] = [-80, 84];

/** The coordinates of a place as a text in a format. */
export function coordinatesText(latDeg: number, lonDeg: number, format: Format): string {
  if (format === "minutes") return `${minutesText(latDeg, "N", "S")} ${minutesText(lonDeg, "E", "W")}`;
  if (format === "mgrs" && latDeg >= MGRS_LIMIT_DEG[0] && latDeg < MGRS_LIMIT_DEG[1]) {
    return mgrs([lonDeg, latDeg], 5).replace(/^(\d+[A-Z])([A-Z]{2})(\d{5})(\d{5})$/, "$1 $2 $3 $4");
  }
  return `${latDeg.toFixed(5)}, ${lonDeg.toFixed(5)}`;
}

function minutesText(deg: number, positive: string, negative: string): string {
  const minutes = Math.round(Math.abs(deg) * 60_000) / 1000;
  const whole = Math.floor(minutes / 60);
  return `${deg < 0 ? negative : positive} ${whole}° ${(minutes - 60 * whole).toFixed(3).padStart(6, "0")}′`;
}

export class CoordinatesControl implements IControl {
  private format: Format = FORMATS.find((each) => each === localStorage.getItem(KEY)) ?? "degrees";
  private place: LngLat | null = null; // under the pointer
  private map: MapView | null = null;
  private text = h("output", { "aria-live": "off" });
  private element = h(
    "button",
    { type: "button", class: "maplibregl-ctrl coordinates", onclick: () => this.next() },
    this.text,
  );

  onAdd(map: MapView): HTMLElement {
    this.map = map;
    map.getContainer().addEventListener("pointermove", (event) => {
      const box = map.getContainer().getBoundingClientRect();
      const isMouse = event.pointerType === "mouse";
      this.place = isMouse ? map.unproject([event.clientX - box.left, event.clientY - box.top]) : null;
      this.show();
    });
    map.getContainer().addEventListener("pointerleave", () => {
      this.place = null;
      this.show();
    });
    map.on("move", () => this.show());
    this.show();
    return this.element;
  }

  onRemove(): void {
    this.element.remove();
    this.map = null;
  }

  private next(): void {
    this.format = FORMATS[(FORMATS.indexOf(this.format) + 1) % FORMATS.length]!;
    localStorage.setItem(KEY, this.format);
    this.show();
  }

  private show(): void {
    if (!this.map) return;
    const { lat, lng } = (this.place ?? this.map.getCenter()).wrap();
    setText(this.text, `${this.place ? "" : `${t("centre")} `}${coordinatesText(lat, lng, this.format)}`);
    this.element.title = t("{format}; press for another format", { format: TITLES[this.format] });
  }
}
