// What a vehicle does and why, in words: for its card, and for the next decision.

import { distanceM } from "./geo.ts";
import { t, word } from "./messages.ts";
import { failingChecks } from "./panels/preflight.ts";
import type { Store } from "./store.ts";
import { type Item, LOITER_UNLIMITED, type LonLat, type Vehicle } from "./types.ts";
import { clock, distance, duration } from "./units.ts";

const PLANNED_MODE = "mission";
const ORDERS: Record<string, string> = { hold: t("Holds"), return: t("Flies home"), land: t("Lands at home") };

/** Why the planner does not steer a vehicle: an order, a landing, a mode, a lost link; "" if it does. */
export function notSteered(vehicle: Vehicle): string {
  if (vehicle.link === "never heard") return t("no heartbeat yet");
  if (vehicle.link === "lost") return t("its link is lost");
  if (vehicle.landing) return t("it lands");
  if (vehicle.order) return t("the order {order} is in force", { order: word(vehicle.order) });
  if (isOnGround(vehicle)) return t("it is on the ground");
  if (vehicle.mode && vehicle.mode !== PLANNED_MODE) return t("its mode is {mode}", { mode: vehicle.mode });
  return "";
}

/** Only vehicles on the ground have pre-flight checks. */
const isOnGround = (vehicle: Vehicle): boolean => vehicle.checks.length > 0 || !vehicle.armed;

/** What a vehicle does and why, as one sentence. */
export function doesAndWhy(store: Store, vehicle: Vehicle): string {
  if (vehicle.link === "never heard") return t("No heartbeat yet");
  if (vehicle.link === "lost") {
    return vehicle.lost_link ? t("Link lost; by its parameters it {lost_link}", { lost_link: vehicle.lost_link }) : t("Link lost; its reaction is unknown");
  }
  if (vehicle.landing) return t("Lands: {landing}", { landing: word(vehicle.landing) });
  if (vehicle.order) return t("{does}, by order", { does: ORDERS[vehicle.order] ?? word(vehicle.order) });
  if (isOnGround(vehicle)) return groundWords(vehicle);
  if (vehicle.mode && vehicle.mode !== PLANNED_MODE) {
    const isSent = store.missions.get(vehicle.vehicle)?.sending ?? null;
    return isSent
      ? t("In mode {mode}, while a mission is in transfer", { mode: vehicle.mode })
      : t("In mode {mode}: not controlled by the planner", { mode: vehicle.mode });
  }
  return steeredWords(store, vehicle);
}

function groundWords(vehicle: Vehicle): string {
  const failing = failingChecks(vehicle).map((check) => check.name);
  if (failing.length) return t("On the ground; checks fail: {failing}", { failing: failing.join(", ") });
  if (vehicle.waits_for_signoff) return t("On the ground; waits for your sign-off");
  return `${t("On the ground")}${vehicle.relief ? `: ${vehicle.relief}` : ""}`;
}

function steeredWords(store: Store, vehicle: Vehicle): string {
  const why = store.missions.get(vehicle.vehicle)?.on_board?.why;
  const mission = why ? t(" (reason of its mission: {why})", { why }) : "";
  if (vehicle.orbit) return t("Orbits its virtual agent{mission}", { mission });
  if (!vehicle.direction) return t("Under way{mission}", { mission });
  const turnedS = vehicle.reversed_at_us === null ? null : store.nowS - vehicle.reversed_at_us / 1e6;
  const RECENT_S = 120;
  if (turnedS !== null && turnedS < RECENT_S) {
    return t("Turned back {duration} ago, now {direction}: the front behind it was more important", { duration: duration(turnedS), direction: word(vehicle.direction) });
  }
  const compared = vehicle.importance_front > vehicle.importance_back
    ? t(": the front ahead is more important than the front behind")
    : "";
  return t("Follows the front {direction}{compared}{mission}", { direction: word(vehicle.direction), compared, mission });
}

/** What comes next: the current item with its distance and time, an expected order, or the landing. */
export function nextWords(store: Store, vehicle: Vehicle): string {
  const state = store.missions.get(vehicle.vehicle);
  if (state?.proposed) return t("a mission waits for your decision");
  if (state?.sending) return t("a new mission is in transfer: {why}", { why: state.sending.why });
  const fix = store.telemetry.get(vehicle.vehicle);
  const items = state?.on_board?.items ?? [];
  const item = vehicle.current_seq === null ? undefined : items[vehicle.current_seq];
  if (!notSteered(vehicle) && fix && item) return itemWords(fix, item, vehicle.current_seq!, items.length);
  if (vehicle.must_land_at_us !== null && !isOnGround(vehicle)) return t("must land at {clock}", { clock: clock(vehicle.must_land_at_us / 1e6) });
  return vehicle.order === "hold" ? t("the order to resume") : "–";
}

function itemWords(
  fix: { lat_deg: number; lon_deg: number; ground_speed_m_s: number }, item: Item, seq: number, count: number,
): string {
  if (item.command === LOITER_UNLIMITED) return t("circles at the end of its mission");
  if (item.lat_deg === null || item.lon_deg === null) return t("item {seq} of {last}", { seq, last: count - 1 });
  const here: LonLat = [fix.lon_deg, fix.lat_deg];
  const m = distanceM(here, [item.lon_deg, item.lat_deg]);
  const time = fix.ground_speed_m_s > 1 ? `, ${duration(m / fix.ground_speed_m_s)}` : "";
  return t("item {seq} of {last} in {distance}{time}", { seq, last: count - 1, distance: distance(m), time });
}
