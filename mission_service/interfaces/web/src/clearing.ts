// Clearing the airspace: the button, its question, and the progress of each vehicle below the alarms.

import { attempt, lacking, showMessage } from "./actions.ts";
import { post } from "./api.ts";
import { confirmed } from "./dialogs.ts";
import { byId, fill, h, setReason, setText } from "./dom.ts";
import { shortcut } from "./keys.ts";
import { t, word } from "./messages.ts";
import type { Store } from "./store.ts";
import type { ClearedVehicle, Clearing } from "./types.ts";
import { counter, duration } from "./units.ts";

const SHOWN_AFTER_S = 60; // a request that has ended remains visible for this time
const WIDE = "(width >= 900px)";

export function clearButton(store: Store): HTMLButtonElement {
  const act = (): void => void clear(store);
  const button = h("button", { id: "clear", type: "button", onclick: act }, t("CLEAR"));
  const renew = (): void => {
    setReason(button, lacking(store, "fly"));
    if (!button.disabled) button.title = t("Clear the airspace: all vehicles land (Ctrl+Shift+L)");
  };
  store.on(["status"], renew);
  renew();
  const isLive = (): boolean => !store.state?.replay;
  shortcut("Ctrl+Shift+L", t("Clear the airspace, after a confirmation: all vehicles land"), act, false, isLive);
  return button;
}

async function clear(store: Store): Promise<void> {
  const reason = lacking(store, "fly");
  if (reason) return showMessage(reason, true);
  const what = store.state?.burn
    ? t("No further drop, the vehicle climbs and holds, and must be landed by its pilot.")
    : t("All vehicles land at home, one after the other at each field.");
  if (!(await confirmed(t("Clear the airspace? {what} No vehicle takes off until all are on the ground.", { what })))) return;
  await attempt(t("Clear the airspace"), async () => {
    const { messages } = await post("airspace/clear");
    return { messages: (messages ?? []).filter((line) => line.includes("clear")) };
  });
}

export function clearingPanel(store: Store): void {
  const title = h("strong");
  const counts = h("span", { role: "status" });
  const cancel = h("button", { type: "button", onclick: () => void stop(store) }, t("Cancel"));
  const rows = h("ul");
  const list = h("details", { open: matchMedia(WIDE).matches }, h("summary", {}, t("Vehicles")), rows);
  byId("clearing").append(h("div", { class: "row" }, title, counts, cancel), list);
  let shown = "";
  const renew = (): void => {
    const clearing = store.state?.airspace.clearing ?? null;
    const isShown = clearing !== null && (clearing.ended_at_us === null
      || store.nowS - clearing.ended_at_us / 1e6 < SHOWN_AFTER_S);
    byId("clearing").hidden = !isShown;
    if (!isShown) return;
    setText(title, titleOf(clearing));
    setText(counts, countsOf(clearing));
    byId("clearing").classList.toggle("missed", clearing.vehicles.some(({ phase }) => phase === "not reached"));
    cancel.hidden = clearing.outcome !== "in force";
    setReason(cancel, lacking(store, "fly"));
    const texts = clearing.vehicles.map((one) => rowText(one, store.nowS));
    if (texts.join("\n") === shown) return;
    shown = texts.join("\n");
    fill(rows, ...clearing.vehicles.map((one, i) => h(
      "li", { class: one.phase === "not reached" ? "missed" : "" }, h("strong", {}, one.vehicle), ` ${texts[i]}`,
    )));
  };
  store.on(["airspace", "telemetry", "status"], renew);
}

async function stop(store: Store): Promise<void> {
  const reason = lacking(store, "fly");
  if (reason) return showMessage(reason, true);
  const question = t("Stop clearing the airspace? Vehicles on their way hold until you resume them.");
  if (await confirmed(question)) await attempt(t("Cancel"), () => post("airspace/cancel-clearing"));
}

function titleOf({ volume, outcome }: Clearing): string {
  const what = volume ? t("Leaving \"{volume}\"", { volume }) : t("All vehicles land");
  if (outcome === "in force") return what;
  return `${what}: ${word(outcome)}`;
}

function countsOf({ volume, vehicles_out, vehicles, last_expected_us }: Clearing): string {
  const missed = vehicles.filter(({ phase }) => phase === "not reached").length;
  const parts = [t("{out} of {all} {where}", { out: vehicles_out, all: vehicles.length, where: word(volume ? "out" : "on the ground") })];
  if (missed) parts.push(t("{missed} NOT REACHED", { missed }));
  if (last_expected_us !== null) parts.push(t("last expected at {counter}", { counter: counter(last_expected_us / 1e6) }));
  return parts.join(", ");
}

function rowText({ phase, why, expected_us, out_by_us }: ClearedVehicle, nowS: number): string {
  if (phase === "not reached") return t("NOT REACHED: {why}. Use the radio", { why });
  if (phase === "out" || phase === "on the ground") return word(phase);
  if (expected_us === null) return word(phase);
  const late = out_by_us !== null && nowS > out_by_us / 1e6 ? t("LATE, ") : "";
  // In steps of 10 s, so that the list is not drawn again at each position.
  const inS = Math.max(0, Math.ceil((expected_us / 1e6 - nowS) / 10) * 10);
  return t("{late}{phase}, expected in {duration}", { late, phase: word(phase), duration: duration(inS) });
}
