// A mission that waits for a person's word, and what would be sent now: figures and differences.

import { attempt, lacking } from "../actions.ts";
import { post } from "../api.ts";
import { fill, h, setReason } from "../dom.ts";
import type { Store } from "../store.ts";
import type { Mission, Preview } from "../types.ts";
import { distance, metres } from "../units.ts";
import { button, figures, section } from "./parts.ts";

export class MissionPart {
  readonly element: HTMLElement;
  private body = h("div");
  private preview: Preview | null = null;
  private shown = "";
  private controls: HTMLButtonElement[];

  constructor(private readonly store: Store) {
    this.controls = [
      button("Preview", () => void this.look(), "Show the mission that would be sent now"),
      button("Plan and send now", () => this.tell("renew", {}), "Plan a new mission and send it"),
    ];
    this.element = section("Mission", h("div", { class: "row orders" }, ...this.controls), this.body);
    store.on(["mission", "chosen"], () => this.renew());
  }

  private path(what: string): string {
    return `vehicles/${encodeURIComponent(this.store.chosen)}/mission/${what}`;
  }

  private tell(what: string, body: object): void {
    void attempt(`Mission: ${what}`, () => post(this.path(what), body)).then((done) => {
      if (done) this.preview = null;
      this.renew(true);
    });
  }

  private async look(): Promise<void> {
    await attempt("Preview", async () => {
      this.preview = await post<Preview>(this.path("preview"));
    });
    this.renew(true);
  }

  private renew(force = false): void {
    const name = this.store.chosen;
    if (this.preview && this.preview.vehicle !== name) this.preview = null;
    const proposed = this.store.missions.get(name)?.proposed ?? null;
    const key = `${name} ${proposed?.mission_hash} ${this.preview?.mission_hash} ${lacking(this.store, "fly")}`;
    for (const control of this.controls) setReason(control, lacking(this.store, "fly"));
    if (key === this.shown && !force) return;
    this.shown = key;
    if (proposed && this.preview?.mission_hash !== proposed.mission_hash) void this.figuresOf(proposed);
    fill(this.body, proposed && this.question(proposed), this.preview && previewed(this.preview));
  }

  /** The figures of what is proposed, where it still is what would be sent. */
  private async figuresOf(proposed: Mission): Promise<void> {
    if (lacking(this.store, "fly")) return;
    const preview = await post<Preview>(this.path("preview")).catch(() => null);
    if (preview?.mission_hash !== proposed.mission_hash) return;
    this.preview = preview;
    this.renew(true);
  }

  private question(mission: Mission): HTMLElement {
    const hash = { hash: mission.mission_hash };
    const answers = [
      button("Accept", () => this.tell("accept", hash), "Send exactly this mission", "go"),
      button("Refuse", () => this.tell("refuse", hash), "Discard this mission", "no-go"),
    ];
    for (const answer of answers) setReason(answer, lacking(this.store, "fly"));
    return h(
      "div",
      { class: "question" },
      h("strong", {}, `This mission needs your decision: ${mission.why}`),
      h("p", {}, `${mission.items.length} items · hash ${mission.mission_hash.slice(0, 12)}`),
      h("div", { class: "row" }, ...answers),
    );
  }
}

function previewed({ figures: told, difference, mission_hash }: Preview): HTMLElement {
  return h(
    "div",
    {},
    figures([
      ["Lowest height", told.min_height_agl_m === null ? "–" : metres(told.min_height_agl_m)],
      ["Length", distance(told.length_m)],
      ["Farthest from home", distance(told.farthest_from_home_m)],
      ["Highest (MSL)", told.highest_amsl_m === null ? null : metres(told.highest_amsl_m)],
      [
        "Changes to the mission on board",
        `${difference.added} items added, ${difference.removed} removed, moved by up to ${metres(difference.farthest_moved_m)}`,
      ],
      ["Outside the landscape", told.outside_landscape ? "YES" : null],
      ["Hash", mission_hash.slice(0, 12)],
    ]),
    ...told.problems.map((problem) => h("p", { class: "bad" }, problem)),
  );
}
