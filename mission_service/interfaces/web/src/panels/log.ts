// The log: alarms, and announcements with the latest first.

import { fill, h } from "../dom.ts";
import type { Store } from "../store.ts";
import { clock } from "../units.ts";
import { section } from "./parts.ts";

const MAX_LINES = 100;

export function logPanel(store: Store): HTMLElement {
  const alarms = h("ul", { class: "log" });
  const announcements = h("ol", { class: "log" });
  const element = h("div", { class: "panel" }, section("Alarms", alarms), section("Announcements", announcements));
  store.on(["announcements", "alarms"], () => {
    const { state } = store;
    if (!state) return;
    const rows = state.alarms.map((alarm) =>
      h("li", { class: alarm.severity }, h("time", {}, clock(alarm.at_us / 1e6)), alarm.text),
    );
    fill(alarms, ...(rows.length ? rows : [h("li", {}, "None.")]));
    fill(
      announcements,
      ...state.announcements
        .slice(-MAX_LINES)
        .reverse()
        .map((line) =>
          h(
            "li",
            { class: line.level },
            h("time", {}, clock(line.at_us / 1e6)),
            `${line.vehicle ? `${line.vehicle}: ` : ""}${line.text}`,
          ),
        ),
    );
  });
  return element;
}
