// The log: active alarms, and all lines with the latest first: announcements, corrections of the fire with their
// author, wind, settings, missions and alarms. Check boxes select the kinds of lines.

import { fill, h } from "../dom.ts";
import { t } from "../messages.ts";
import { showPhoto, withoutName } from "../photos.ts";
import type { Store } from "../store.ts";
import type { Announcement, LogRecord, State } from "../types.ts";
import { clock } from "../units.ts";
import { button, section } from "./parts.ts";

const MAX_LINES = 200;

type Kind = "announcement" | LogRecord["kind"];
type Line = Announcement & { kind: Kind };

const KINDS: [Kind, string][] = [
  ["announcement", t("Announcements")],
  ["fire", t("Fire and wind")],
  ["settings", t("Settings")],
  ["note", t("Notes")],
  ["mission", t("Missions")],
  ["alarm", t("Alarms")],
];

export function logPanel(store: Store): HTMLElement {
  const alarms = h("ul", { class: "log" });
  const lines = h("ol", { class: "log" });
  const shown = new Set<Kind>(KINDS.map(([kind]) => kind));
  const boxes = KINDS.map(([kind, label]) => {
    const box = h("input", { type: "checkbox", id: `log-${kind}`, checked: true });
    box.addEventListener("change", () => {
      if (box.checked) shown.add(kind);
      else shown.delete(kind);
      renew();
    });
    return h("label", { class: "check" }, box, label);
  });

  function renew(): void {
    const { state } = store;
    if (!state) return;
    const rows = state.alarms.map((alarm) =>
      h("li", { class: alarm.severity }, h("time", {}, clock(alarm.at_us / 1e6)), alarm.text),
    );
    fill(alarms, ...(rows.length ? rows : [h("li", {}, t("None."))]));
    const found = linesOf(state).filter((line) => shown.has(line.kind)).slice(0, MAX_LINES);
    fill(lines, ...(found.length ? found.map(row) : [h("li", {}, t("None."))]));
  }

  store.on(["announcements", "records", "alarms"], renew);
  return h(
    "div",
    { class: "panel" },
    section(t("Active alarms"), alarms),
    section(t("Log"), h("div", { class: "checks" }, ...boxes), lines),
  );
}

/** Announcements and records, the latest first. */
function linesOf(state: State): Line[] {
  const announced = state.announcements.map((line): Line => ({ ...line, kind: "announcement" }));
  return [...announced, ...state.records].sort((a, b) => b.id - a.id);
}

function row(line: Line): HTMLElement {
  const vehicle = line.vehicle ? `${line.vehicle}: ` : "";
  const note = "photo" in line ? (line as LogRecord) : null;
  const words = note ? withoutName(note) : line.text;
  const text = words.startsWith(vehicle) ? words : vehicle + words;
  const photo = note?.photo && button(t("Photo"), () => void showPhoto(note), t("Show the photo of this note"));
  return h("li", { class: line.level }, h("time", {}, clock(line.at_us / 1e6)), text, photo);
}
