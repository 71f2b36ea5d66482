// The fire panel: burned area, visible layers, wind dial, and perimeters from files.

import { attempt, lacking, showMessage } from "../actions.ts";
import { ask, get, post } from "../api.ts";
import { coalesced } from "../coalesce.ts";
import { fill, h, setReason, setText } from "../dom.ts";
import type { ArrivalScale } from "../fire_layer.ts";
import { acceptsChange, type Preview } from "../fire_preview.ts";
import type { Group } from "../map.ts";
import { t } from "../messages.ts";
import type { Store } from "../store.ts";
import { area, clock, compass, speed, speedUnit } from "../units.ts";
import { type Wind, windDial } from "../wind_dial.ts";
import { arrivalsSection } from "./arrivals.ts";
import { button, layerBox, scaleBar, section, type Toggle } from "./parts.ts";
import { productsSection } from "./products.ts";

interface Weather {
  weather: { wind_speed_m_s: number; wind_from_deg: number };
  wind_set: { speed_m_s: number; from_deg: number } | null;
}

const KEY_COLOURS: [string, string][] = [
  ["now", t("Burned now")],
  ["then", t("Burned at the slider's time")],
  ["burned", t("Drawn: burned")],
  ["burning", t("Drawn: burning")],
  ["unburned", t("Drawn: unburned")],
];

export class FirePanel {
  readonly element = h("div", { class: "panel" });
  private size = h("p", { class: "big" });
  private warnings = h("ul", { class: "log" });
  private legend = h("div", { class: "legend" });
  private dial = windDial((wind) => this.drawWind(wind));
  private now: Wind | null = null;
  private entered: Wind | null = null;
  private from = h("input", { type: "number", min: 0, max: 360, step: 5, id: "wind-from" });
  private speed = h("input", { type: "number", min: 0, max: 60, step: "any", id: "wind-speed" });
  private speedLabel = h("label", { for: "wind-speed" });
  private current = h("p", { class: "words" });
  private confirm = button(t("Set this wind"), () => this.setWind(), t("Use this wind in the fire forecast from now on"), "primary");
  private file = h("input", { type: "file", id: "perimeter", accept: ".geojson,.json,.kml,.kmz,.zip" });

  constructor(
    private readonly store: Store,
    groups: Record<string, Group>,
    toggle: Toggle,
  ) {
    const boxes = Object.entries(groups).map(([key, group]) => layerBox(key, group, toggle, `show-${key}`));
    for (const input of [this.from, this.speed]) input.addEventListener("input", () => this.readFields());
    this.file.addEventListener("change", () => void this.upload(this.file.files?.[0]));
    this.element.append(
      this.size,
      this.warnings,
      arrivalsSection(store),
      section(t("Shown on the map"), h("div", { class: "checks" }, ...boxes), this.legend),
      section(
        t("Wind"),
        this.current,
        h("div", { class: "wind" }, this.dial.element, h("div", { class: "fields" },
          h("label", { for: "wind-from" }, t("From (°)")), this.from,
          this.speedLabel, this.speed,
          this.confirm)),
      ),
      section(
        t("Perimeter from a file"),
        h("label", { for: "perimeter" }, t("GeoJSON, KML, KMZ or zipped Shapefile; or drop it on the map")),
        this.file,
      ),
      productsSection(store),
    );
    const weather = coalesced(async () => {
      const { weather: air, wind_set: windSet } = await get<Weather>("weather");
      this.now = windSet ?? { from_deg: air.wind_from_deg, speed_m_s: air.wind_speed_m_s };
      this.renew();
    }, 2000);
    store.on(["fire"], weather);
    store.on(["fire", "moment"], () => this.renew());
    store.on(["alarms"], () => this.listWarnings());
    store.on(["burn", "images"], () => {
      for (const box of this.element.querySelectorAll<HTMLElement>("label[data-group]")) {
        const ofBurns = box.dataset.group === "unit" || box.dataset.group === "drops";
        box.hidden = (ofBurns && !store.state?.burn) || (box.dataset.group === "images" && !store.image);
      }
    });
    this.showScale(null);
  }

  private drawWind(wind: Wind): void {
    this.entered = wind;
    this.from.value = String(wind.from_deg);
    this.speed.value = String(Math.round((10 * wind.speed_m_s) / speedUnit().si) / 10);
    this.renew();
  }

  private readFields(): void {
    const [from_deg, speed_m_s] = [this.from.valueAsNumber, this.speed.valueAsNumber * speedUnit().si];
    this.entered = Number.isFinite(from_deg) && Number.isFinite(speed_m_s) ? { from_deg, speed_m_s } : null;
    this.renew();
  }

  private async setWind(): Promise<void> {
    const wind = this.entered;
    if (!wind) return;
    if (await attempt(t("Wind {wind}", { wind: windText(wind) }), () => post("wind", wind))) this.entered = null;
    this.renew();
  }

  /** Send the perimeter in a file. */
  async upload(file: File | undefined): Promise<void> {
    if (!file) return;
    const reason = lacking(this.store, "correct");
    if (reason) return showMessage(reason, true);
    await attempt(t("Perimeter {name}", { name: file.name }), async () => {
      const headers = { "Content-Type": file.type || "application/octet-stream" };
      const send = (query: string): Promise<Response> =>
        ask(`fire/perimeter${query}`, { method: "POST", body: file, headers });
      const preview = async (): Promise<Preview> => (await (await send("?preview=true")).json()) as Preview;
      if (!(await acceptsChange(this.store, preview))) return { messages: [t("not applied")] };
      const answer = await send("");
      const { accepted } = (await answer.json()) as { accepted: { messages: string[] }[] };
      return { messages: [t("{count, plural, one {# outline} other {# outlines}} accepted", { count: accepted.length }), ...accepted.flatMap((each) => each.messages)] };
    });
    this.file.value = "";
  }

  private renew(): void {
    const { fire } = this.store.state ?? {};
    if (!fire) return;
    setText(this.speedLabel, t("Speed ({unit})", { unit: speedUnit().name }));
    setText(this.size, t("{area} burned", { area: area(fire.area_ha * 1e4) }));
    const by = fire.wind_set_by ? t(", set by {wind_set_by}", { wind_set_by: fire.wind_set_by }) : "";
    setText(this.current, this.now ? t("Now {wind}{by}", { wind: windText(this.now, this.now.from_deg.toFixed(0)), by }) : t("Unknown"));
    this.dial.show(this.now, this.entered);
    const reason = lacking(this.store, "correct");
    for (const input of [this.from, this.speed, this.file]) setReason(input, reason);
    setReason(this.confirm, reason || (this.entered ? "" : t("Draw or enter a wind first")));
    setText(
      this.confirm,
      this.entered ? t("Set: from {from_deg}°, {speed}", { from_deg: this.entered.from_deg, speed: speed(this.entered.speed_m_s) }) : t("Set this wind"),
    );
  }

  /** List the warnings about the scenario and the edge, also after the banner is acknowledged. */
  private listWarnings(): void {
    const ofFire = (this.store.state?.alarms ?? []).filter((each) => /^(edge|input)\b/.test(each.alarm));
    fill(this.warnings, ...ofFire.map((each) => h("li", { class: each.severity }, each.text)));
  }

  /** Show the legend, with the colours of arrival times if these are visible. */
  showScale(scale: ArrivalScale | null): void {
    fill(this.legend, ...KEY_COLOURS.map(([key, label]) => h("span", {}, h("i", { class: `key ${key}` }), label)));
    if (!scale) return;
    const bar = scaleBar(scale.scale.map(({ at_s, colour }) => [clock(at_s), colour]));
    this.legend.append(h("strong", {}, t("Fire arrives at (h:min)")), bar);
  }
}

const windText = ({ from_deg, speed_m_s }: Wind, from = String(from_deg)): string =>
  t("from {from}° ({compass}), {speed}", { from, compass: compass(from_deg), speed: speed(speed_m_s) });
