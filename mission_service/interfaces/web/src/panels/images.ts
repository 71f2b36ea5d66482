// The part of the sensors panel about images: the box of the layer, the selected image and the legend.

import { fill, h } from "../dom.ts";
import { axesOf, IMAGE_GROUPS, sourceOf } from "../image_layer.ts";
import { t } from "../messages.ts";
import { imageKey, type Store } from "../store.ts";
import type { MapImage } from "../types.ts";
import { accuracy, counter, duration, length } from "../units.ts";
import { button, figures, layerBox, scaleBar, type Toggle } from "./parts.ts";

export class ImagesPart {
  readonly element = h("div", { class: "images", hidden: true });
  private detail = h("div");
  private older = button(t("Older"), () => this.step(-1), t("Select the image before this one"));
  private newer = button(t("Newer"), () => this.step(1), t("Select the image after this one"));
  private newest = button(t("Newest"), () => this.store.selectImage(""), t("Select the newest image, and then each new one"));

  constructor(private readonly store: Store, toggle: Toggle) {
    const box = { ...IMAGE_GROUPS.images!, label: t("Show the images on the map") };
    this.element.append(
      layerBox("images", box, toggle, "show-images-here"),
      h("div", { class: "row" }, this.older, this.newer, this.newest),
      this.detail,
    );
    store.on(["images", "telemetry"], () => this.renew());
  }

  private step(by: number): void {
    const { images, image } = this.store;
    const next = images[images.indexOf(image!) + by];
    if (next) this.store.selectImage(imageKey(next));
  }

  private renew(): void {
    const { images, image } = this.store;
    this.element.hidden = !image;
    if (!image || !this.element.isConnected) return;
    const place = images.indexOf(image);
    this.older.disabled = place === 0;
    this.newer.disabled = place === images.length - 1;
    this.newest.setAttribute("aria-pressed", String(!this.store.imageKey));
    const rows = this.rowsOf(image, t("{number} of {all}", { number: place + 1, all: images.length }));
    const text = JSON.stringify([rows, image.scale]);
    if (this.detail.dataset.text === text) return; // an unchanged text must not affect screen readers
    this.detail.dataset.text = text;
    const scale = image.scale.map(([value, colour]): [string, string] => [String(Math.round(value)), colour]);
    fill(this.detail, figures(rows), h("div", { class: "legend" }, h("strong", {}, image.unit), scaleBar(scale)));
  }

  private rowsOf(image: MapImage, place: string): [string, string][] {
    const atS = image.at_us / 1e6;
    const [major, minor] = axesOf(image).map((m) => 2 * m) as [number, number];
    const sd = image.position_sd_m;
    return [
      [t("Image"), `${place}, ${image.name}`],
      [t("Taken"), t("{counter}, {duration} ago", { counter: counter(atS), duration: duration(Math.max(0, this.store.nowS - atS)) })],
      [t("Source"), sourceOf(image, this.store)],
      [t("Place"), accuracy(sd)],
      [t("90 % ellipse"), t("{major} × {minor}, {degrees}° from north", { major: length(major), minor: length(minor), degrees: image.major_from_deg.toFixed(0) })],
    ];
  }
}
