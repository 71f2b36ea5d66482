// The proposed mission, which an operator accepts or refuses, and the preview of the next mission.

import { attempt, lacking } from "../actions.ts";
import { post } from "../api.ts";
import { fill, h, setReason } from "../dom.ts";
import { t, word } from "../messages.ts";
import { chosenUnits } from "../preferences.ts";
import { whenReleased } from "../presses.ts";
import type { Store } from "../store.ts";
import type { Mission, Preview } from "../types.ts";
import { distance, heightAgl, heightMsl, length } from "../units.ts";
import { button, figures, section } from "./parts.ts";

export class MissionPart {
  readonly element: HTMLElement;
  private body = h("div");
  private preview: Preview | null = null;
  private shown = "";
  private controls: HTMLButtonElement[];

  constructor(private readonly store: Store) {
    this.controls = [
      button(t("Preview"), () => this.showPreview(), t("Show the mission that would be sent now")),
      button(t("Plan and send now"), () => this.request("renew", {}), t("Plan a new mission and send it")),
    ];
    this.element = section(t("Mission"), h("div", { class: "row orders" }, ...this.controls), this.body);
    store.on(["mission", "chosen"], () => this.renew());
  }

  private path(action: string): string {
    return `vehicles/${encodeURIComponent(this.store.chosen)}/mission/${action}`;
  }

  private async request(action: string, body: object): Promise<void> {
    const done = await attempt(t("Mission: {action}", { action: word(action) }), () => post(this.path(action), body));
    if (done) this.preview = null;
    this.renew(true);
  }

  private async showPreview(): Promise<void> {
    await attempt(t("Preview"), async () => {
      this.preview = await post<Preview>(this.path("preview"));
    });
    this.renew(true);
  }

  private renew(force = false): void {
    const name = this.store.chosen;
    if (this.preview && this.preview.vehicle !== name) this.preview = null;
    const proposed = this.store.missions.get(name)?.proposed ?? null;
    const key = `${chosenUnits()} ${name} ${proposed?.mission_hash} ${this.preview?.mission_hash} ${lacking(this.store, "fly")}`;
    for (const control of this.controls) setReason(control, lacking(this.store, "fly"));
    if (key === this.shown && !force) return;
    this.shown = key;
    if (proposed && this.preview?.mission_hash !== proposed.mission_hash) void this.figuresOf(proposed);
    whenReleased(this.body, () => {
      fill(this.body, proposed && this.question(proposed), this.preview && previewed(this.preview));
    });
  }

  /** Show the figures of the proposed mission, if it is still the mission that would be sent. */
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
      button(t("Accept"), () => this.request("accept", hash), t("Send exactly this mission"), "go"),
      button(t("Refuse"), () => this.request("refuse", hash), t("Discard this mission"), "no-go"),
    ];
    for (const answer of answers) setReason(answer, lacking(this.store, "fly"));
    return h(
      "div",
      { class: "question" },
      h("strong", {}, t("This mission needs your decision: {why}", { why: mission.why })),
      h("p", {}, t("{count, plural, one {# item} other {# items}} · hash {hash}", { count: mission.items.length, hash: mission.mission_hash.slice(0, 12) })),
      h("div", { class: "row" }, ...answers),
    );
  }
}

function previewed({ figures: values, difference, mission_hash }: Preview): HTMLElement {
  return h(
    "div",
    {},
    figures([
      [t("Lowest height"), heightAgl(values.min_height_agl_m)],
      [t("Length"), distance(values.length_m)],
      [t("Farthest from home"), distance(values.farthest_from_home_m)],
      [t("Highest"), values.highest_amsl_m === null ? null : heightMsl(values.highest_amsl_m)],
      [
        t("Changes to the mission on board"),
        t("{added, plural, one {# item} other {# items}} added, {removed} removed, moved by up to {length}", { added: difference.added, removed: difference.removed, length: length(difference.farthest_moved_m) }),
      ],
      [t("Outside the landscape"), values.outside_landscape ? t("YES") : null],
      [t("Hash"), mission_hash.slice(0, 12)],
    ]),
    ...values.problems.map((problem) => h("p", { class: "bad" }, problem)),
  );
}
