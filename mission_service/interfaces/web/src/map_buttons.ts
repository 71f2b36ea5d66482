// Buttons on the map: follow the chosen vehicle, and the display settings.

import { createElement, LocateFixed, Settings2 } from "lucide";
import type { IControl, Map as MapView } from "maplibre-gl";
import { h } from "./dom.ts";
import { shortcut } from "./keys.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";

export class MapButtons implements IControl {
  private follow = h("button", {
    type: "button", class: "follow", title: t("Keep the chosen vehicle in the middle (G)"),
    "aria-label": t("Follow the chosen vehicle"), "aria-pressed": "false", onclick: () => this.toggle(),
  }, createElement(LocateFixed));
  private element: HTMLElement;
  private map: MapView | null = null;
  private isFollowing = false;
  private isHeld = false; // a pointer is down on the map: setting the centre would end a gesture before the map moves

  constructor(private readonly store: Store, settings: () => void) {
    const open = h("button", {
      type: "button", class: "settings", title: t("Language, units, colours, basemap"), "aria-label": t("Display settings"), onclick: settings,
    }, createElement(Settings2));
    this.element = h("div", { class: "maplibregl-ctrl maplibregl-ctrl-group" }, this.follow, open);
    shortcut("g", t("Follow the chosen vehicle, or stop"), () => this.toggle());
    store.on(["telemetry", "chosen"], () => this.centre());
  }

  onAdd(map: MapView): HTMLElement {
    this.map = map;
    map.on("dragstart", () => this.set(false)); // the user moves the map
    map.getCanvasContainer().addEventListener("pointerdown", () => (this.isHeld = true));
    const released = (): void => void requestAnimationFrame(() => (this.isHeld = false)); // after the map's frame
    for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, released);
    return this.element;
  }

  onRemove(): void {
    this.element.remove();
    this.map = null;
  }

  private toggle(): void {
    this.set(!this.isFollowing);
    this.centre();
  }

  private set(isFollowing: boolean): void {
    this.isFollowing = isFollowing;
    this.follow.setAttribute("aria-pressed", String(isFollowing));
  }

  private centre(): void {
    const fix = this.store.telemetry.get(this.store.chosen);
    if (this.isFollowing && !this.isHeld && fix) this.map?.setCenter([fix.lon_deg, fix.lat_deg]);
  }
}
