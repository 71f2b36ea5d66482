// The next decision of the chosen vehicle: the strip of importances, and a text.

import { get } from "../api.ts";
import { coalesced } from "../coalesce.ts";
import { h, setText } from "../dom.ts";
import { t, word } from "../messages.ts";
import type { Store } from "../store.ts";
import { importanceText, makeStrip } from "../strip.ts";
import type { Importance } from "../types.ts";
import { notSteered } from "../vehicle_words.ts";
import { section } from "./parts.ts";

const EVERY_MS = 1500;

export class DecisionPart {
  readonly element: HTMLElement;
  private strip = makeStrip();
  private text = h("p", { class: "words" });
  private shownFor = "";

  constructor(private readonly store: Store) {
    this.element = section(t("Next decision"), this.strip.element, this.text);
    store.on(["chosen", "vehicle", "telemetry"], coalesced(() => this.refresh(), EVERY_MS));
  }

  private async refresh(): Promise<void> {
    const name = this.store.chosen;
    const vehicle = this.store.vehicles.get(name);
    // Rules without importance (burns, formations) have no strip.
    const rule = this.store.state?.rule ?? "";
    this.element.hidden = !vehicle || rule === "burn" || rule === "formation";
    if (!vehicle || this.element.hidden || !this.element.checkVisibility()) return;
    if (name !== this.shownFor) this.strip.show(null);
    this.shownFor = name;
    const why = notSteered(vehicle);
    if (why) {
      this.strip.show(null, t("No decision now"));
      setText(this.text, t("The planner does not steer it: {why}.", { why }));
      return;
    }
    // A vehicle has importances after its first lap.
    const importance = vehicle.decisions
      ? await get<Importance>(`vehicles/${encodeURIComponent(name)}/importance`)
      : null;
    if (name !== this.store.chosen) return;
    const shown = importance !== null && importance.cells.length > 0 ? importance : null;
    this.strip.show(shown, t("No decision before arrival at the front"));
    const direction = vehicle.direction ? t("Direction: {direction}", { direction: word(vehicle.direction) }) : t("No direction yet");
    setText(this.text, shown ? `${direction}; ${importanceText(shown)}.` : `${direction}.`);
  }
}
