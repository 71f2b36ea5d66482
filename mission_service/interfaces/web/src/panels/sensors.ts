// The sensors panel: the contribution and the state of each source of observations.

import { fill, h, setText } from "../dom.ts";
import type { Group } from "../map.ts";
import { count, t } from "../messages.ts";
import { colourOf } from "../observation_layer.ts";
import type { Store } from "../store.ts";
import type { Source } from "../types.ts";
import { accuracy, duration } from "../units.ts";
import { ImagesPart } from "./images.ts";
import { layerBox, type Toggle } from "./parts.ts";

// In the order of the list: sources that need attention come first.
const WORDS: Record<Source["state"], string> = {
  failed: t("failed"),
  contradicts: t("contradicts others"),
  silent: t("silent"),
  late: t("late"),
  waiting: t("waiting"),
  live: t("live"),
};
const ORDER = Object.keys(WORDS);

interface Row {
  item: HTMLElement;
  state: HTMLElement;
  last: HTMLElement;
  total: HTMLElement;
  cells: HTMLElement;
  problem: HTMLElement;
}

export class SensorsPanel {
  readonly element = h("div", { class: "panel" });
  private title = h("p", { class: "big" });
  private list = h("ul", { class: "sources", "aria-label": t("Sources of observations") });
  private rows = new Map<string, Row>();

  constructor(private readonly store: Store, groups: Record<string, Group>, toggle: Toggle) {
    this.element.append(
      this.title,
      layerBox("observations", { ...groups.observations!, label: t("Show the observations on the map") }, toggle, "show-observed"),
      new ImagesPart(store, toggle).element,
      this.list,
    );
    store.on(["sources", "telemetry", "chosen"], () => this.renew());
  }

  private renew(): void {
    if (!this.element.isConnected || this.element.hidden) return;
    const sources = [...(this.store.state?.sources ?? [])];
    sources.sort((a, b) => ORDER.indexOf(a.state) - ORDER.indexOf(b.state)); // else by name, as received
    const names = sources.map(({ source }) => source);
    if (names.join("\n") !== [...this.rows.keys()].join("\n")) this.makeRows(sources);
    const live = sources.filter(({ state }) => state === "live").length;
    setText(this.title, sources.length ? t("{live} of {all} sources live", { live, all: sources.length }) : t("No observations yet"));
    for (const source of sources) this.renewRow(source);
  }

  private makeRows(sources: Source[]): void {
    this.rows.clear();
    fill(
      this.list,
      ...sources.map(({ source, kind }) => {
        const swatch = h("i", { class: "swatch" });
        swatch.style.background = colourOf(source); // a script: the policy permits no style in markup
        const row: Row = {
          item: h("li"),
          state: h("span"),
          last: h("span", { class: "detail" }),
          total: h("span", { class: "detail" }),
          cells: h("span", { class: "detail" }),
          problem: h("span", { class: "detail problem" }),
        };
        const name = h("strong", { title: kind }, source);
        row.item.append(swatch, name, row.state, row.last, row.total, row.cells, row.problem);
        this.rows.set(source, row);
        return row.item;
      }),
    );
  }

  private renewRow(source: Source): void {
    const row = this.rows.get(source.source)!;
    row.state.className = `state ${source.state}`;
    setText(row.state, source.kind === "person" && source.state === "live" ? t("person") : WORDS[source.state]);
    setText(row.last, this.lastText(source));
    setText(row.total, totalText(source));
    const { burned_cells, unburned_cells } = source;
    setText(row.cells, source.observations ? t("Cells: {burned} burned, {unburned} unburned", { burned: count(burned_cells), unburned: count(unburned_cells) }) : "");
    setText(row.problem, source.problem);
  }

  private lastText({ last_at_us, usual_interval_s }: Source): string {
    if (last_at_us === null) return t("No observation yet");
    const age = t("Last {duration} ago", { duration: duration(Math.max(0, this.store.nowS - last_at_us / 1e6)) });
    return usual_interval_s === null ? age : t("{age}, usually every {interval}", { age, interval: interval(usual_interval_s) });
  }
}

const interval = (s: number): string => (s < 10 ? `${s} s` : duration(s));

function totalText({ observations, position_sd_m, not_used }: Source): string {
  if (!observations) return "";
  const unused = not_used ? t(", {count} not used", { count: count(not_used) }) : "";
  return `${t("{count, plural, one {# observation} other {# observations}}", { count: observations })}${unused}, ${accuracy(position_sd_m)}`;
}
