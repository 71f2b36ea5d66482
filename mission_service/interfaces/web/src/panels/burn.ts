// The burn panel: GO/NO-GO checklist, plan with its safety figures, and presence at a station.

import { attempt, lacking } from "../actions.ts";
import { post } from "../api.ts";
import { fill, h, setReason, setText } from "../dom.ts";
import { t, word } from "../messages.ts";
import { chosenUnits } from "../preferences.ts";
import { whenReleased } from "../presses.ts";
import type { Store } from "../store.ts";
import type { Burn, IgnitionPlan, ListItem } from "../types.ts";
import { clock, compass, duration, heightAgl, length, speed } from "../units.ts";
import { button, figures, section } from "./parts.ts";

const PHASES: Record<string, string> = {
  waiting: t("waiting"), planning: t("planning"), proposed: t("proposed"), approved: t("approved"), flying: t("flying"),
  climbing: t("climbing"),
};
const PRESENT_MS = 5000;
const CONFIRM_MS = 8000;

export class BurnPanel {
  readonly element = h("div", { class: "panel" });
  private state = h("p", { class: "big" });
  private station = h("select", { id: "station" });
  private watch = h("input", { type: "checkbox", id: "watching" });
  private list = h("ul", { class: "go-list" });
  private listState = h("p", { class: "words" });
  private plan = h("div");
  private line = h("input", { type: "number", min: 1, max: 1000, id: "line-spacing", placeholder: t("unchanged") });
  private drop = h("input", { type: "number", min: 1, max: 1000, id: "drop-spacing", placeholder: t("unchanged") });
  private planNow = button(t("Plan the next line"), () => this.planLine(), "", "primary");
  private shown = "";

  constructor(private readonly store: Store) {
    this.element.append(
      this.state,
      h("div", { class: "row" }, h("label", { for: "station" }, t("My station")), this.station),
      h("label", { class: "check" }, this.watch, t("I am present and watching (required for drops)")),
      section(t("Plan"), this.plan),
      section(t("GO / NO-GO"), this.listState, this.list),
      section(
        t("Next line"),
        h("div", { class: "fields" },
          h("label", { for: "line-spacing" }, t("Line spacing (m)")), this.line,
          h("label", { for: "drop-spacing" }, t("Drop spacing (m)")), this.drop),
        this.planNow,
      ),
    );
    setInterval(() => {
      if (this.watch.checked && !lacking(store, "approve")) {
        void post("burn/present", this.operator()).catch(() => undefined);
      }
    }, PRESENT_MS);
    store.on(["burn"], () => this.renew());
  }

  private operator(): { station?: string } {
    return this.station.value ? { station: this.station.value } : {};
  }

  private request(label: string, action: string, body: object = {}): Promise<boolean> {
    return attempt(label, () => post(`burn/${action}`, { ...body, ...this.operator() }));
  }

  private planLine(): Promise<boolean> {
    const body: Record<string, number> = {};
    if (this.line.value) body.line_spacing_m = this.line.valueAsNumber;
    if (this.drop.value) body.drop_spacing_m = this.drop.valueAsNumber;
    return this.request(t("Plan the next line"), "plan", body);
  }

  private renew(): void {
    const burn = this.store.state?.burn;
    if (!burn) return;
    const { guidance } = burn;
    setText(
      this.state,
      guidance.complete ? t("Burn complete") : t("Line {line}: {phase}; {spheres, plural, one {# sphere} other {# spheres}} left", { line: guidance.line, phase: PHASES[guidance.phase] ?? guidance.phase, spheres: guidance.spheres_left }),
    );
    this.stations(burn);
    const checked = burn.plans.find((each) => each.plan_hash === burn.plan_hash);
    const key = JSON.stringify([
      guidance.checklist, burn.plan_hash, checked, guidance.phase, this.store.state?.roles,
      burn.drops.length, burn.drops.at(-1)?.outcome, chosenUnits(),
    ]);
    for (const control of [this.planNow, this.line, this.drop]) setReason(control, lacking(this.store, "fly"));
    setReason(this.watch, lacking(this.store, "approve"));
    if (key === this.shown) return;
    this.shown = key;
    whenReleased(this.element, () => {
      this.showList(burn);
      fill(this.plan, ...this.planParts(burn));
    });
  }

  private stations(burn: Burn): void {
    const names = burn.stations.map((station) => station.name);
    if (names.join() === [...this.station.options].map((option) => option.value).join()) return;
    fill(this.station, ...names.map((name) => h("option", { value: name }, name)));
  }

  private showList({ guidance: { checklist } }: Burn): void {
    setText(
      this.listState,
      checklist.complete ? t("All GO") : t("{open} of {all} items not GO: no flight", { open: checklist.open, all: checklist.items.length }),
    );
    const focus = (document.activeElement as HTMLElement | null)?.dataset.key;
    fill(this.list, ...checklist.items.map((item) => this.listRow(item)));
    if (focus) this.list.querySelector<HTMLElement>(`[data-key="${CSS.escape(focus)}"]`)?.focus();
  }

  private listRow(item: ListItem): HTMLElement {
    const answer = (label: string, action: string, kind: string): HTMLButtonElement => {
      const made = button(label, () => this.request(`${label}: ${item.item}`, action, { item: item.item }), "", kind);
      made.setAttribute("aria-pressed", String(item.answer === action));
      made.dataset.key = `${action} ${item.item}`;
      setReason(made, lacking(this.store, "approve"));
      return made;
    };
    const by = item.by ? ` (${item.by}${item.station ? t(" at {station}", { station: item.station }) : ""})` : "";
    return h(
      "li",
      { class: item.answer },
      h("span", {}, `${item.item}${by}`),
      answer(t("GO"), "go", "go"),
      answer(t("NO-GO"), "no-go", "no-go"),
    );
  }

  private planParts(burn: Burn): Node[] {
    const { plan, plan_hash, guidance } = burn;
    if (!plan) return [h("p", {}, t("No plan is proposed."))];
    const checked = burn.plans.find((each) => each.plan_hash === plan_hash);
    const parts: Node[] = [safetyFigures(plan, plan_hash)];
    if (guidance.approved_by) {
      parts.push(h("p", { class: "good" }, t("Approved by {approved_by}", { approved_by: guidance.approved_by })));
      parts.push(this.outcomes(burn));
    } else {
      parts.push(h("p", { class: "words" }, `${t("Not approved")}${checked?.why_not ? `: ${checked.why_not}` : ""}`));
    }
    const reject = button(t("Reject"), () => this.request(t("Reject"), "reject", { hash: plan_hash }), t("Reject this plan"), "no-go");
    const approve = this.approveButton(plan_hash);
    setReason(reject, lacking(this.store, "approve"));
    if (guidance.approved_by) parts.push(h("div", { class: "row" }, reject));
    else parts.push(h("div", { class: "row" }, approve, reject));
    parts.push(planFigures(plan), dropLegend());
    return parts;
  }

  /** The button to approve a plan. It must be pressed twice, because drops are irreversible. */
  private approveButton(hash: string): HTMLButtonElement {
    let sure = false;
    const made = button(t("Approve"), () => {
      if (sure) return this.request(t("Approve"), "approve", { hash });
      sure = true;
      made.textContent = t("Approve {hash}? Press again", { hash: hash.slice(0, 8) });
      setTimeout(() => {
        sure = false;
        made.textContent = t("Approve");
      }, CONFIRM_MS);
      return undefined;
    }, t("Approve exactly this plan"), "go");
    setReason(made, lacking(this.store, "approve"));
    return made;
  }

  private outcomes({ drops, plan, plan_hash }: Burn): HTMLElement {
    const mine = drops.filter((drop) => drop.plan_hash === plan_hash);
    const count = (outcome: string): number => mine.filter((drop) => drop.outcome === outcome).length;
    const counts = ["done", "refused", "unknown", "ordered"].filter(count).map((each) => `${count(each)} ${word(each)}`);
    return h("p", {}, t("Drops: {counts} of {all}", { counts: counts.join(", ") || t("none yet"), all: plan?.drops.length ?? 0 }));
  }
}

/** The figures that an operator must check before the approval. */
function safetyFigures(plan: IgnitionPlan, hash: string): HTMLElement {
  const skipped = plan.skipped.length ? t("; {count} skipped as unsafe", { count: plan.skipped.length }) : "";
  return figures([
    [t("Line"), `${plan.line}, ${plan.vehicle}`],
    [t("Shortest time to fire"), t("{duration} (minimum {duration2})", { duration: duration(plan.min_time_margin_s), duration2: duration(plan.time_margin_s) })],
    [t("Distance from fire"), t("at least {length}", { length: length(plan.distance_margin_m) })],
    [t("Drops"), `${plan.drops.length}${skipped}`],
    [t("Duration"), duration(plan.duration_s)],
    [t("Hash"), hash.slice(0, 12)],
  ]);
}

function planFigures(plan: IgnitionPlan): HTMLElement {
  return figures([
    [t("Begins"), clock(plan.begin_us / 1e6)],
    [t("Approve before"), clock(plan.valid_until_us / 1e6)],
    [t("Drop height"), heightAgl(plan.drop_height_m)],
    [t("Safe height"), heightAgl(plan.safe_height_m)],
    [t("Speed"), speed(plan.speed_m_s)],
    [t("Wind"), t("from {wind_from_deg}° ({compass}), {speed}", { wind_from_deg: plan.wind_from_deg.toFixed(0), compass: compass(plan.wind_from_deg), speed: speed(plan.wind_speed_m_s) })],
    [t("Spheres left at the end"), String(plan.spheres_left)],
  ]);
}

function dropLegend(): HTMLElement {
  const kinds: [string, string][] = [
    ["planned", t("planned")],
    ["skipped", t("skipped as unsafe")],
    ["ordered", t("ordered")],
    ["done", t("done")],
    ["unknown", t("unknown")],
    ["refused", t("refused")],
  ];
  return h(
    "div",
    { class: "legend" },
    h("strong", {}, t("Drops on the map:")),
    ...kinds.map(([key, label]) => h("span", {}, h("i", { class: `dot ${key}` }), label)),
  );
}
