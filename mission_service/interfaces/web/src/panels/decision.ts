// The next decision of the chosen vehicle: the strip, and in words.

import { get } from "../api.ts";
import { coalesced } from "../coalesce.ts";
import { h, setText } from "../dom.ts";
import type { Store } from "../store.ts";
import { inWords, makeStrip } from "../strip.ts";
import type { Importance } from "../types.ts";
import { section } from "./parts.ts";

const EVERY_MS = 1500;

export class DecisionPart {
  readonly element: HTMLElement;
  private strip = makeStrip();
  private words = h("p", { class: "words" });
  private shownFor = "";

  constructor(private readonly store: Store) {
    this.element = section("Next decision", this.strip.element, this.words);
    const ask = coalesced(() => this.ask(), EVERY_MS);
    store.on(["chosen", "vehicle", "telemetry"], ask);
  }

  private async ask(): Promise<void> {
    const name = this.store.chosen;
    const vehicle = this.store.vehicles.get(name);
    // Rules without importance (burns, formations) have no strip.
    const rule = this.store.state?.rule ?? "";
    this.element.hidden = !vehicle || rule === "burn" || rule === "formation";
    if (!vehicle || this.element.hidden || !this.element.checkVisibility()) return;
    if (name !== this.shownFor) this.strip.show(null);
    this.shownFor = name;
    // Before the first lap is flown there are no importances.
    const told = vehicle.decisions
      ? await get<Importance>(`vehicles/${encodeURIComponent(name)}/importance`)
      : null;
    if (name !== this.store.chosen) return;
    const there = told !== null && told.cells.length > 0 ? told : null;
    this.strip.show(there);
    const flies = vehicle.direction ? `Direction: ${vehicle.direction}` : "No direction yet";
    setText(this.words, there ? `${flies}; ${inWords(there)}.` : `${flies}.`);
  }
}
