// The sensors panel: what each source of observations has contributed, and whether it still sends.

import { fill, h, setText } from "../dom.ts";
import type { Group } from "../map.ts";
import { colourOf } from "../observation_layer.ts";
import type { Store } from "../store.ts";
import type { Source } from "../types.ts";
import { duration, metres } from "../units.ts";
import { layerBox, type Toggle } from "./parts.ts";

const WORDS: Record<Source["state"], string> = {
  waiting: "waiting",
  live: "live",
  late: "late",
  silent: "silent",
  contradicts: "contradicts others",
  failed: "failed",
};
const count = (value: number): string => value.toLocaleString("en");

interface Row {
  item: HTMLElement;
  state: HTMLElement;
  last: HTMLElement;
  total: HTMLElement;
  problem: HTMLElement;
}

export class SensorsPanel {
  readonly element = h("div", { class: "panel" });
  private title = h("p", { class: "big" });
  private list = h("ul", { class: "sources", "aria-label": "Sources of observations" });
  private rows = new Map<string, Row>();

  constructor(private readonly store: Store, groups: Record<string, Group>, toggle: Toggle) {
    this.element.append(
      this.title,
      layerBox("observations", { ...groups.observations!, label: "Show the observations on the map" }, toggle, "show-observed"),
      this.list,
    );
    store.on(["sources", "telemetry", "chosen"], () => this.renew());
  }

  private renew(): void {
    if (!this.element.isConnected || this.element.hidden) return;
    const sources = this.store.state?.sources ?? [];
    const names = sources.map(({ source }) => source);
    if (names.join("\n") !== [...this.rows.keys()].join("\n")) this.makeRows(sources);
    const live = sources.filter(({ state }) => state === "live").length;
    setText(this.title, sources.length ? `${live} of ${sources.length} sources live` : "No observations yet");
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
          problem: h("span", { class: "detail problem" }),
        };
        row.item.append(swatch, h("strong", { title: kind }, source), row.state, row.last, row.total, row.problem);
        this.rows.set(source, row);
        return row.item;
      }),
    );
  }

  private renewRow(source: Source): void {
    const row = this.rows.get(source.source)!;
    row.state.className = `state ${source.state}`;
    setText(row.state, source.kind === "person" && source.state === "live" ? "person" : WORDS[source.state]);
    setText(row.last, this.lastText(source));
    setText(row.total, totalText(source));
    setText(row.problem, source.problem);
  }

  private lastText({ last_at_us, usual_interval_s, position_sd_m }: Source): string {
    if (last_at_us === null) return "no observation yet";
    const age = `${duration(Math.max(0, this.store.nowS - last_at_us / 1e6))} ago`;
    const usual = usual_interval_s === null ? "" : ` · usually each ${duration(usual_interval_s)}`;
    return `${age}${usual} · ± ${metres(position_sd_m)}`;
  }
}

function totalText({ observations, burned_cells, unburned_cells, not_used }: Source): string {
  if (!observations) return "";
  const unused = not_used ? `, ${count(not_used)} not used` : "";
  return `${count(observations)} observations${unused}: ${count(burned_cells)} cells burned, ${count(unburned_cells)} unburned`;
}
