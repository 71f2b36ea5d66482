// The planners' settings: fields for those that may change in flight, and a list of all.

import { attempt, lacking } from "../actions.ts";
import { get, post } from "../api.ts";
import { coalesced } from "../coalesce.ts";
import { fill, h, setReason } from "../dom.ts";
import { t } from "../messages.ts";
import type { Store } from "../store.ts";
import type { Planner } from "../types.ts";
import { button, figures, section } from "./parts.ts";

const EVERY_MS = 1000;
const TUNABLE: [string, string, number][] = [
  ["alpha", t("α: assumed unevenness of the fire (0: no reversals)"), 0.1],
  ["reversal_margin", t("Minimum gain of a reversal (1 = 100 %)"), 0.05],
  ["dwell_s", t("Minimum time between reversals (s)"), 5],
];

export class PlannerPanel {
  readonly element = h("div", { class: "panel" });
  private fields = new Map<string, HTMLInputElement>();
  private rest = h("div");
  private save = button(t("Use from now on"), () => this.send(), "", "primary");

  constructor(private readonly store: Store) {
    const form = h("div", { class: "fields" });
    for (const [key, label, step] of TUNABLE) {
      const field = h("input", { type: "number", step, min: 0, id: `planner-${key}` });
      this.fields.set(key, field);
      form.append(h("label", { for: `planner-${key}` }, label), field);
    }
    this.element.append(section(t("Planner"), form, this.save), section(t("All settings"), this.rest));
    const read = coalesced(() => this.read(), EVERY_MS);
    store.on(["status"], () => {
      this.renew();
      read(); // the status changes when settings change
    });
  }

  private async send(): Promise<void> {
    const planner = this.store.state?.planner ?? {};
    const body: Record<string, number> = {};
    for (const [key, field] of this.fields) {
      if (field.value !== "" && field.valueAsNumber !== planner[key]) body[key] = field.valueAsNumber;
    }
    await attempt(t("Planner"), () => post("planner", body, "PATCH"));
    await this.read();
  }

  private async read(): Promise<void> {
    const planner = await get<Planner>("planner");
    if (this.store.state) this.store.state.planner = planner;
    this.renew();
  }

  private renew(): void {
    const planner = this.store.state?.planner ?? {};
    const reason = lacking(this.store, "fly");
    for (const [key, field] of this.fields) {
      const has = typeof planner[key] === "number";
      setReason(field, reason || (has ? "" : t("This rule does not have this setting")));
      if (document.activeElement !== field) field.value = has ? String(planner[key]) : "";
    }
    setReason(this.save, reason);
    const rows = Object.entries(planner).map(([key, value]): [string, string] => [key, valueText(value)]);
    fill(this.rest, figures(rows));
  }
}

const valueText = (value: unknown): string =>
  typeof value === "number" ? String(Number(value.toPrecision(6))) : typeof value === "object" ? JSON.stringify(value) : String(value);
