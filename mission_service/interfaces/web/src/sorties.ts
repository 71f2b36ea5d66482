// The timeline of sorties below the map: which vehicle must land next and when, and a row for each
// vehicle with its time on task, its flight home and its landing, on one axis from now.

import { byId, fill, h, setText } from "./dom.ts";
import { t, word } from "./messages.ts";
import { failingChecks } from "./panels/preflight.ts";
import type { Store } from "./store.ts";
import type { Vehicle } from "./types.ts";

const WIDE = "(width >= 900px) and (height >= 500px)";
const SOON_S = 300; // from then on a row is marked
const MIN_AXIS_S = 600;
const TICKS_S = [120, 300, 600, 900, 1800, 3600, 7200, 14_400];
const MAX_TICKS = 6;
const MAX_NAMES = 3; // in the sentence above the rows
const LAST_TICK = 0.85; // the text of a later mark would be beyond the axis

const PARTS = { "on-task": t("on task"), "flies-home": t("flies home"), lands: t("lands") };

type Part = keyof typeof PARTS;
type Urgency = "" | "soon" | "late";

/** One vehicle: its place in the order of landings, its texts, and the parts of its bar. */
interface Row {
  name: string;
  rank: number; // in the air with a time, in the air without, on the ground
  atS: number; // mission time of the landing, for the order
  sentence: string; // "must land in 12 min (14:32)"
  when: string; // "in 12 min (14:32)"
  note: string;
  urgency: Urgency;
  partsS: [Part, number, number][]; // name, begin and end from now
}

export function sortiesPanel(store: Store): void {
  const title = h("strong", { id: "next-landing" });
  const axis = h("div", { class: "axis", "aria-hidden": "true" });
  const list = h("ol");
  const legend = h(
    "span",
    { class: "keys", "aria-hidden": "true" },
    ...Object.entries(PARTS).map(([part, name]) => h("span", {}, h("i", { class: part }), name)),
  );
  const details = h("details", { open: matchMedia(WIDE).matches }, h("summary", {}, title, legend), axis, list);
  byId("sorties").append(details);
  let shown = "";
  const renew = (): void => {
    const vehicles = [...store.vehicles.values()];
    byId("sorties").hidden = vehicles.length === 0;
    const rows = vehicles.map((one) => rowOf(store, one, vehicles));
    rows.sort((a, b) => a.rank - b.rank || a.atS - b.atS || a.name.localeCompare(b.name, undefined, { numeric: true }));
    setText(title, titleOf(rows));
    byId("sorties").className = rows[0]?.urgency ?? "";
    const text = JSON.stringify(rows);
    if (text === shown) return;
    shown = text;
    const lengthS = Math.max(MIN_AXIS_S, ...rows.flatMap((row) => row.partsS.map(([, , end]) => end)));
    const isFlying = rows.some((row) => row.partsS.length > 0);
    axis.hidden = !isFlying;
    fill(axis, h("span"), isFlying && ticksOf(lengthS));
    fill(list, ...rows.map((row, i) => elementOf(row, lengthS, i === 0)));
  };
  store.on(["vehicle", "telemetry", "status", "alarms"], renew);
}

function elementOf(row: Row, lengthS: number, isFirst: boolean): HTMLElement {
  const bar = h("span", { class: "bar", "aria-hidden": "true" });
  for (const [part, begin, end] of row.partsS) {
    const piece = h("i", { class: part });
    piece.style.left = `${(100 * begin) / lengthS}%`; // by script: the content security policy forbids style attributes
    piece.style.width = `${(100 * (end - begin)) / lengthS}%`;
    bar.append(piece);
  }
  return h(
    "li",
    { class: row.urgency, "aria-current": isFirst && row.rank === 0 },
    h("strong", {}, row.name),
    bar,
    h("span", { class: "when" }, row.when),
    h("span", { class: "note" }, row.note),
  );
}

/** Marks at round times from now. */
function ticksOf(lengthS: number): HTMLElement {
  const everyS = TICKS_S.find((each) => lengthS / each <= MAX_TICKS) ?? TICKS_S.at(-1)!;
  const marks = h("span", { class: "bar" });
  for (let atS = 0; atS < LAST_TICK * lengthS; atS += everyS) {
    const mark = h("i", {}, atS ? t("{minutes} min", { minutes: atS / 60 }) : t("now"));
    mark.style.left = `${(100 * atS) / lengthS}%`;
    marks.append(mark);
  }
  return marks;
}

/** The sentence of the vehicle that lands next, and the vehicles of which this is unknown. */
function titleOf(rows: Row[]): string {
  const unknown = rows.filter(({ rank }) => rank === 1).map(({ name }) => name);
  const first = rows[0];
  if (first?.rank === 0) {
    const others = unknown.length ? t("; unknown: {names}", { names: namesOf(unknown) }) : "";
    return `${first.name} ${first.sentence}${others}`;
  }
  if (unknown.length) return t("Unknown when {names} must land", { names: namesOf(unknown) });
  return rows.length === 1 ? t("{vehicle} is on the ground", { vehicle: first?.name ?? "" }) : t("All vehicles are on the ground");
}

/** The first names, and the number of the others. */
function namesOf(names: string[]): string {
  const more = names.length - MAX_NAMES;
  return more > 0 ? t("{names} and {more} more", { names: names.slice(0, MAX_NAMES).join(", "), more }) : names.join(", ");
}

function rowOf(store: Store, vehicle: Vehicle, all: Vehicle[]): Row {
  const base = { name: vehicle.vehicle, atS: Infinity, partsS: [], urgency: "" as Urgency, note: noteOf(vehicle, all) };
  // In the air a vehicle has no checks.
  if (!vehicle.armed || vehicle.checks.length) {
    const atS = /^(relieves|takes off|resumes)/.test(vehicle.relief) ? 0 : Infinity; // the next one first
    return { ...base, rank: 2, atS, sentence: "", when: groundText(vehicle), note: groundNote(vehicle) };
  }
  const { time_on_task_s: onTaskS, time_home_s: homeS, time_landing_s: landingS, must_land_at_us: mustUs } = vehicle;
  if (onTaskS === null) {
    return { ...base, rank: 1, sentence: "", when: t("unknown: no estimate of its energy") };
  }
  if (homeS === null || landingS === null || mustUs === null) {
    const when = t("no way home against the wind");
    return { ...base, rank: 0, atS: -Infinity, sentence: t("has {when}", { when }), when, urgency: "late" };
  }
  // A vehicle on its way home lands before it must.
  const isEarly = goesHome(vehicle) && onTaskS > 0;
  const atS = mustUs / 1e6 - (isEarly ? onTaskS : 0);
  const inS = atS - store.nowS;
  const leavesS = isEarly ? 0 : Math.max(0, inS - landingS - homeS);
  const landsS = Math.max(0, inS - landingS);
  const parts: [Part, number, number][] = [["on-task", 0, leavesS], ["flies-home", leavesS, landsS], ["lands", landsS, inS]];
  const when = inS < 0 ? t("{minutes} ago ({time})", { minutes: minutes(-inS), time: store.clockText(atS) }) : t("in {minutes} ({time})", { minutes: minutes(inS), time: store.clockText(atS) });
  return {
    ...base,
    rank: 0,
    atS,
    sentence: inS < 0 ? t("should have landed {when}", { when }) : isEarly ? t("lands {when}", { when }) : t("must land {when}", { when }),
    when,
    urgency: inS < 0 || (onTaskS <= 0 && !goesHome(vehicle)) ? "late" : inS < SOON_S ? "soon" : "",
    partsS: parts.filter(([, begin, end]) => end > begin).map(([name, begin, end]) => [name, round(begin), round(end)]),
  };
}

// The bars change in steps of 10 s, so that the rows are not drawn again at each report of a position.
const round = (s: number): number => Math.round(s / 10) * 10;

/** Whole minutes, rounded down: a landing is never shown later than it must be. */
const minutes = (s: number): string => (s < 60 ? t("less than 1 min") : t("{minutes} min", { minutes: Math.floor(s / 60) }));

const goesHome = ({ order, landing, relief }: Vehicle): boolean =>
  landing !== "" || order === "return" || order === "land" || relief === "flies home";

/** In the air: the link, the order, and the vehicle that relieves this one. */
function noteOf(vehicle: Vehicle, all: Vehicle[]): string {
  const next = all.find((other) => other.relief.startsWith(`relieves ${vehicle.vehicle} `));
  const parts = [
    vehicle.link === "lost" ? t("LINK LOST") : "",
    (vehicle.time_on_task_s ?? 1) <= 0 && !goesHome(vehicle) ? t("must fly home now") : "",
    vehicle.landing ? t("landing: {landing}", { landing: word(vehicle.landing) }) : vehicle.order ? t("order: {order}", { order: word(vehicle.order) }) : word(vehicle.relief),
    next ? t("relieved by {vehicle}{relief}", { vehicle: next.vehicle, relief: next.relief.slice(`relieves ${vehicle.vehicle}`.length) }) : "",
  ];
  return parts.filter((part) => part !== "").join(", ");
}

/** On the ground: whether the vehicle can take off, or what it waits for. */
function groundText(vehicle: Vehicle): string {
  if (vehicle.link === "never heard") return t("no heartbeat yet");
  if (vehicle.link === "lost") return t("on the ground, link lost");
  const failing = failingChecks(vehicle);
  if (failing.length) return t("not ready: {failing}", { failing: failing.map((check) => check.name).join(", ") });
  if (vehicle.relief.startsWith("waits for")) return vehicle.relief;
  if (vehicle.waits_for_signoff) return t("waits for sign-off");
  return vehicle.checks.length ? t("ready") : t("on the ground");
}

function groundNote({ relief, battery_pct }: Vehicle): string {
  const task = relief.startsWith("waits for") ? "" : relief;
  return [task, battery_pct === null ? "" : t("battery {percent} %", { percent: battery_pct.toFixed(0) })].filter((part) => part !== "").join(", ");
}
