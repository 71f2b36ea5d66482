// What a vehicle does and why, in words: for its card, and for the next decision.

import { distanceM } from "./geo.ts";
import { failingChecks } from "./panels/preflight.ts";
import type { Store } from "./store.ts";
import { type Item, LOITER_UNLIMITED, type LonLat, type Vehicle } from "./types.ts";
import { clock, distance, duration } from "./units.ts";

const PLANNED_MODE = "mission";
const ORDERS: Record<string, string> = { hold: "Holds", return: "Flies home", land: "Lands at home" };

/** Why the planner does not steer a vehicle: an order, a landing, a mode, a lost link; "" if it does. */
export function notSteered(vehicle: Vehicle): string {
  if (vehicle.link === "never heard") return "no heartbeat yet";
  if (vehicle.link === "lost") return "its link is lost";
  if (vehicle.landing) return "it lands";
  if (vehicle.order) return `the order ${vehicle.order} is in force`;
  if (isOnGround(vehicle)) return "it is on the ground";
  if (vehicle.mode && vehicle.mode !== PLANNED_MODE) return `its mode is ${vehicle.mode}`;
  return "";
}

/** Only vehicles on the ground have pre-flight checks. */
const isOnGround = (vehicle: Vehicle): boolean => vehicle.checks.length > 0 || !vehicle.armed;

/** What a vehicle does and why, as one sentence. */
export function doesAndWhy(store: Store, vehicle: Vehicle): string {
  if (vehicle.link === "never heard") return "No heartbeat yet";
  if (vehicle.link === "lost") {
    return vehicle.lost_link ? `Link lost; by its parameters it ${vehicle.lost_link}` : "Link lost; its reaction is unknown";
  }
  if (vehicle.landing) return `Lands: ${vehicle.landing}`;
  if (vehicle.order) return `${ORDERS[vehicle.order] ?? vehicle.order}, by order`;
  if (isOnGround(vehicle)) return groundWords(vehicle);
  if (vehicle.mode && vehicle.mode !== PLANNED_MODE) {
    const isSent = store.missions.get(vehicle.vehicle)?.sending ?? null;
    return `In mode ${vehicle.mode}${isSent ? ", while a mission is in transfer" : ": not controlled by the planner"}`;
  }
  return steeredWords(store, vehicle);
}

function groundWords(vehicle: Vehicle): string {
  const failing = failingChecks(vehicle).map((check) => check.name);
  if (failing.length) return `On the ground; checks fail: ${failing.join(", ")}`;
  if (vehicle.waits_for_signoff) return "On the ground; waits for your sign-off";
  return `On the ground${vehicle.relief ? `: ${vehicle.relief}` : ""}`;
}

function steeredWords(store: Store, vehicle: Vehicle): string {
  const why = store.missions.get(vehicle.vehicle)?.on_board?.why;
  const mission = why ? ` (reason of its mission: ${why})` : "";
  if (vehicle.orbit) return `Orbits its virtual agent${mission}`;
  if (!vehicle.direction) return `Under way${mission}`;
  const turnedS = vehicle.reversed_at_us === null ? null : store.nowS - vehicle.reversed_at_us / 1e6;
  const RECENT_S = 120;
  if (turnedS !== null && turnedS < RECENT_S) {
    return `Turned back ${duration(turnedS)} ago, now ${vehicle.direction}: the front behind it was more important`;
  }
  const compared = vehicle.importance_front > vehicle.importance_back
    ? ": the front ahead is more important than the front behind"
    : "";
  return `Follows the front ${vehicle.direction}${compared}${mission}`;
}

/** What comes next: the current item with its distance and time, an expected order, or the landing. */
export function nextWords(store: Store, vehicle: Vehicle): string {
  const state = store.missions.get(vehicle.vehicle);
  if (state?.proposed) return "a mission waits for your decision";
  if (state?.sending) return `a new mission is in transfer: ${state.sending.why}`;
  const fix = store.telemetry.get(vehicle.vehicle);
  const items = state?.on_board?.items ?? [];
  const item = vehicle.current_seq === null ? undefined : items[vehicle.current_seq];
  if (!notSteered(vehicle) && fix && item) return itemWords(fix, item, vehicle.current_seq!, items.length);
  if (vehicle.must_land_at_us !== null && !isOnGround(vehicle)) return `must land at ${clock(vehicle.must_land_at_us / 1e6)}`;
  return vehicle.order === "hold" ? "the order to resume" : "–";
}

function itemWords(
  fix: { lat_deg: number; lon_deg: number; ground_speed_m_s: number }, item: Item, seq: number, count: number,
): string {
  if (item.command === LOITER_UNLIMITED) return "circles at the end of its mission";
  if (item.lat_deg === null || item.lon_deg === null) return `item ${seq} of ${count - 1}`;
  const here: LonLat = [fix.lon_deg, fix.lat_deg];
  const m = distanceM(here, [item.lon_deg, item.lat_deg]);
  const time = fix.ground_speed_m_s > 1 ? `, ${duration(m / fix.ground_speed_m_s)}` : "";
  return `item ${seq} of ${count - 1} in ${distance(m)}${time}`;
}
