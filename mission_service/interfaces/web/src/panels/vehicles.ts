// The vehicles panel: a list of all, the details of the chosen vehicle, and orders.

import { attempt, lacking } from "../actions.ts";
import { download, post } from "../api.ts";
import { confirmed } from "../dialogs.ts";
import { fill, h, setReason, setText } from "../dom.ts";
import { shortcut } from "../keys.ts";
import { t, word } from "../messages.ts";
import type { Store } from "../store.ts";
import type { Mission, Vehicle } from "../types.ts";
import { clock, duration, heightAgl, heightMsl, length, speed } from "../units.ts";
import { doesAndWhy, nextWords } from "../vehicle_words.ts";
import { DecisionPart } from "./decision.ts";
import { button, figures, releaseButtons } from "./parts.ts";
import { MissionPart } from "./mission.ts";
import { PreflightPart, failingChecks } from "./preflight.ts";

const ORDERS: [string, string, string][] = [
  ["hold", t("Hold"), t("Circle or hover at the current place")],
  ["resume", t("Resume"), t("Continue under the planner")],
  ["return", t("Return"), t("Fly home")],
  ["land", t("Land"), t("Land at home, into the wind")],
  ["go-around", t("Go around"), t("Break off the landing, climb and hold")],
  ["start", t("Start"), t("Arm and fly the mission on board")],
];

interface Answer {
  messages: string[];
  confirm?: boolean;
}

export class VehiclesPanel {
  readonly element = h("div", { class: "panel" });
  private list = h("ul", { class: "vehicles", "aria-label": t("Vehicles") });
  private rows = new Map<string, { row: HTMLButtonElement; state: HTMLElement; motion: HTMLElement }>();
  private title = h("h3");
  private does = h("p", { class: "does" });
  private tiles = h("dl", { class: "tiles" });
  private facts = h("div");
  private orders: HTMLButtonElement[] = [];
  private decision: DecisionPart;
  private mission: MissionPart;
  private preflight: PreflightPart;

  constructor(private readonly store: Store) {
    this.decision = new DecisionPart(store);
    this.mission = new MissionPart(store);
    this.preflight = new PreflightPart(store);
    const all = this.ordersFor(() => "", t("all vehicles"));
    const one = this.ordersFor(() => this.store.chosen, t("this vehicle"));
    this.element.append(
      h("div", {}, this.list, h("div", { class: "row all orders" }, h("span", {}, t("All:")), ...all)),
      h("div", { class: "card" }, this.title, this.does, this.tiles, h("div", { class: "row orders" }, ...one), this.preflight.element, this.decision.element),
      h("div", {}, this.facts),
      h(
        "div",
        {},
        this.mission.element,
        button(t("Download .plan"), () => this.save(), t("The mission on board, for QGroundControl")),
      ),
    );
    shortcut("n", t("Next vehicle"), () => this.step(1));
    shortcut("p", t("Previous vehicle"), () => this.step(-1));
    shortcut("h", t("Hold the chosen vehicle"), () => void this.order("hold", store.chosen));
    shortcut("r", t("Resume the chosen vehicle"), () => void this.order("resume", store.chosen));
    shortcut("H", t("Hold all vehicles"), () => void this.order("hold", ""));
    store.on(["chosen"], () => releaseButtons(this.element)); // orders to another vehicle need not wait
    store.on(["vehicle", "telemetry", "mission", "chosen"], () => this.renew());
  }

  private ordersFor(vehicle: () => string, target: string): HTMLButtonElement[] {
    const made = ORDERS.map(([order, label, title]) =>
      button(label, () => this.order(order, vehicle()), `${title} (${target})`),
    );
    this.orders.push(...made);
    return made;
  }

  /** Send an order to one vehicle, or to all for an empty name. */
  private async order(order: string, vehicle: string): Promise<void> {
    if (lacking(this.store, "fly")) return;
    const path = `vehicles/${encodeURIComponent(vehicle || "all")}/${order}`;
    const label = ORDERS.find(([name]) => name === order)?.[1];
    await attempt(`${label} ${vehicle || t("all vehicles")}`, () => ordered(path));
  }

  private step(by: number): void {
    const names = [...this.store.vehicles.keys()];
    if (!names.length) return;
    const at = names.indexOf(this.store.chosen);
    this.store.choose(names[(at + by + names.length) % names.length]!);
  }

  private async save(): Promise<void> {
    const name = this.store.chosen;
    await attempt(t("Download"), () => download(`vehicles/${encodeURIComponent(name)}/mission.plan`, `${name}.plan`));
  }

  private renew(): void {
    if (!this.element.isConnected || this.element.hidden) return;
    const { store } = this;
    const names = [...store.vehicles.keys()];
    if (names.join() !== [...this.rows.keys()].join()) this.makeRows(names);
    for (const [name, { row, state, motion }] of this.rows) this.renewRow(name, row, state, motion);
    const vehicle = store.vehicles.get(store.chosen);
    setText(this.title, vehicle ? `${vehicle.vehicle} · ${vehicle.stack} ${word(vehicle.kind)}` : t("No vehicle"));
    setText(this.does, vehicle ? doesAndWhy(store, vehicle) : "");
    const tiles = vehicle ? tilesOf(store, vehicle) : [];
    const tilesText = JSON.stringify(tiles);
    if (tilesText !== this.tiles.dataset.text) { // an unchanged text must not affect screen readers
      this.tiles.dataset.text = tilesText;
      fill(this.tiles, ...tiles.map(([name, value, kind]) => h("div", { class: kind }, h("dt", {}, name), h("dd", {}, value))));
    }
    const facts = vehicle ? figures(this.factsOf(vehicle)) : h("p");
    if (facts.textContent !== this.facts.textContent) fill(this.facts, facts);
    const reason = lacking(store, "fly");
    for (const order of this.orders) setReason(order, reason);
  }

  private makeRows(names: string[]): void {
    this.rows.clear();
    fill(
      this.list,
      ...names.map((name) => {
        const [state, motion] = [h("span", { class: "state" }), h("span", { class: "moves" })];
        const row = h(
          "button",
          { type: "button", onclick: () => this.store.choose(name) },
          h("strong", {}, name),
          state,
          motion,
        );
        this.rows.set(name, { row, state, motion });
        return h("li", {}, row);
      }),
    );
  }

  private renewRow(name: string, row: HTMLElement, state: HTMLElement, motion: HTMLElement): void {
    const vehicle = this.store.vehicles.get(name);
    const fix = this.store.telemetry.get(name);
    if (!vehicle) return;
    row.setAttribute("aria-current", String(name === this.store.chosen));
    row.classList.toggle("lost", vehicle.link === "lost");
    setText(state, shortState(vehicle));
    setText(
      motion,
      fix ? `${length(fix.height_agl_m ?? fix.altitude_relative_m)} · ${speed(fix.ground_speed_m_s)}` : t("no position yet"),
    );
  }

  private factsOf(vehicle: Vehicle): [string, string | null][] {
    const { store } = this;
    const fix = store.telemetry.get(vehicle.vehicle);
    const mission = store.missions.get(vehicle.vehicle);
    return [
      [
        t("State"),
        t("link {link}, mode {mode}, {armed}", { link: word(vehicle.link), mode: vehicle.mode || word("unknown"), armed: word(vehicle.armed ? "armed" : "disarmed") }),
      ],
      [t("Links"), linksText(vehicle, store.nowS)],
      [t("Order"), word(vehicle.order) || null],
      [t("Landing"), word(vehicle.landing) || null],
      [t("Relief"), word(vehicle.relief) || null],
      [t("If the link is lost"), lostLinkText(vehicle)],
      [t("Energy"), energyText(vehicle)],
      [t("Remote ID"), vehicle.remote_id || null],
      [t("Position"), vehicle.position_good ? null : t("NOT GOOD: {position_fix}", { position_fix: vehicle.position_fix })],
      [t("Height"), fix ? `${heightAgl(fix.height_agl_m)}, ${heightMsl(fix.altitude_amsl_m)}` : "–"],
      [t("Motion"), fix ? t("{speed}, heading {heading_deg}°", { speed: speed(fix.ground_speed_m_s), heading_deg: fix.heading_deg.toFixed(0) }) : "–"],
      // A replay sends no mission to the vehicle.
      [store.state?.replay ? t("Simulated mission") : t("On board"), missionText(mission?.on_board ?? null, vehicle)],
      [t("In transfer"), mission?.sending ? missionText(mission.sending, null) : null],
      [
        t("Last reversal"),
        vehicle.reversed_at_us === null
          ? vehicle.decisions ? t("not yet") : null
          : t("at {clock}, {duration} ago; {reversals} in total", { clock: clock(vehicle.reversed_at_us / 1e6), duration: duration(store.nowS - vehicle.reversed_at_us / 1e6), reversals: vehicle.reversals }),
      ],
      [
        t("Orbit"),
        vehicle.orbit ? t("radius {radius}, {direction}, camera width {width}", {
          radius: length(Math.abs(vehicle.orbit.radius_m)),
          direction: word(vehicle.orbit.radius_m < 0 ? "anticlockwise" : "clockwise"),
          width: length(vehicle.orbit.view_width_m),
        }) : null,
      ],
    ];
  }
}

/** Send an order; if the service requires a confirmation, ask the operator and send it again. */
async function ordered(path: string): Promise<Answer> {
  const answer = await post<Answer>(path);
  if (!answer.confirm) return answer;
  const question = answer.messages.map((line) => line.replace(/^confirm:\s*/, "")).join("\n");
  if (!(await confirmed(question))) return { messages: [t("not confirmed, no order sent")] };
  return post<Answer>(path, { confirmed: true });
}

/** The figures of a vehicle's card: name, value, and its urgency. */
function tilesOf(store: Store, vehicle: Vehicle): [string, string, string][] {
  const onTaskS = vehicle.time_on_task_s;
  const left = onTaskS === null ? t("unknown") : onTaskS > 0 ? t("{minutes} min", { minutes: Math.floor(onTaskS / 60) }) : t("NONE");
  const lossPct = vehicle.links.find((link) => link.in_use)?.loss_pct ?? null;
  const link = vehicle.link !== "online" || lossPct === null || lossPct < 1 ? word(vehicle.link) : t("online, {percent} % lost", { percent: lossPct.toFixed(0) });
  return [
    [t("On task for"), left, onTaskS !== null && onTaskS <= 0 ? "bad" : ""],
    [t("Battery"), vehicle.battery_pct === null ? t("unknown") : `${vehicle.battery_pct.toFixed(0)} %`, ""],
    [t("Link"), link, vehicle.link === "lost" ? "bad" : ""],
    [t("Next"), nextWords(store, vehicle), "wide"],
  ];
}

function shortState(vehicle: Vehicle): string {
  if (vehicle.link === "lost") return t("LINK LOST");
  if (vehicle.link === "never heard") return t("no heartbeat yet");
  const battery = vehicle.battery_pct === null ? "" : ` · ${vehicle.battery_pct.toFixed(0)} %`;
  const energy = vehicle.time_on_task_s === null ? "" : ` · ${timesText(vehicle)}`;
  const landing = vehicle.landing ? t(" · LANDING: {landing}", { landing: word(vehicle.landing) }) : "";
  const order = landing || (vehicle.order ? ` · ${word(vehicle.order).toUpperCase()}` : "");
  const relief = vehicle.relief ? ` · ${word(vehicle.relief)}` : "";
  const silent = vehicle.links.length > 1 && vehicle.links.some((link) => link.state === "silent");
  const oneLink = silent ? t(" · ONE LINK") : "";
  return `${vehicle.mode || t("mode?")}${battery}${energy}${oneLink}${order}${relief}${takeoffText(vehicle)}`;
}

/** For a vehicle on the ground: whether checks fail, or its takeoff waits for a sign-off. */
function takeoffText(vehicle: Vehicle): string {
  const failing = failingChecks(vehicle);
  if (failing.length) return t(" · NO-GO: {failing}", { failing: failing.map((check) => check.name).join(", ") });
  return vehicle.checks.length && vehicle.waits_for_signoff ? t(" · waits for sign-off") : "";
}

/** The times left by the vehicle's energy: "12 min on task, 3 min home". */
function timesText(vehicle: Vehicle): string {
  const onTaskS = vehicle.time_on_task_s ?? 0;
  const onTask = onTaskS > 0 ? t("{minutes} min on task", { minutes: Math.floor(onTaskS / 60) }) : t("NO TIME ON TASK");
  const home = vehicle.time_home_s === null ? t("no way home against the wind") : t("{minutes} min home", { minutes: Math.ceil(vehicle.time_home_s / 60) });
  return `${onTask}, ${home}`;
}

function energyText(vehicle: Vehicle): string | null {
  return vehicle.time_on_task_s === null ? null : t("{times} (source: {energy_source})", { times: timesText(vehicle), energy_source: vehicle.energy_source });
}

/** The reaction to a lost link, the height of a return and the reaction to a breached fence. */
function lostLinkText(vehicle: Vehicle): string | null {
  if (vehicle.link === "never heard") return null;
  if (!vehicle.lost_link) return t("unknown");
  const height = vehicle.return_height_m === null ? "" : t("; return height {length}", { length: length(vehicle.return_height_m) });
  return t("{lost_link}{height}; fence: {fence_action}", { lost_link: vehicle.lost_link, height, fence_action: vehicle.fence_action });
}

/** Each link with its quality: "udpin:0.0.0.0:14550: in use, 3 % lost; serial:…: SILENT for 12 s". */
function linksText(vehicle: Vehicle, nowS: number): string | null {
  const several = vehicle.links.length > 1;
  const texts = vehicle.links.map((link) => {
    const use = link.in_use && several ? t("in use, ") : "";
    const lost = link.loss_pct === null ? "" : t(", {percent} % lost", { percent: link.loss_pct.toFixed(0) });
    if (link.state === "waiting") return t("{link}: {use}no frame yet", { link: link.link, use });
    if (link.state !== "silent") return `${link.link}: ${use}${link.state === "up" ? t("good") : t("BAD")}${lost}`;
    const since = link.silent_since_us === null ? "" : t(" for {duration}", { duration: duration(nowS - link.silent_since_us / 1e6) });
    return t("{link}: {use}SILENT{since}", { link: link.link, use, since });
  });
  return texts.join("; ") || null;
}

function missionText(mission: Mission | null, vehicle: Vehicle | null): string {
  if (!mission) return t("nothing");
  const current = vehicle?.current_seq === null || !vehicle ? "" : t(", current item {number}", { number: vehicle.current_seq });
  return t("mission {number}: {count, plural, one {# item} other {# items}}{current} ({why})", { number: mission.mission_id, count: mission.items.length, current, why: mission.why });
}
