// The time slider: selects the past, current or forecast burned area.

import { byId, h, setText } from "./dom.ts";
import { shortcut } from "./keys.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";
import { clock, moment } from "./units.ts";

const STEP_MIN = 5;
const MAX_MIN = 360; // the longest forecast of the service
const MAX_PAST_MIN = 180;

export function timeBar(store: Store): void {
  const slider = h("input", {
    type: "range",
    min: -60,
    max: MAX_MIN,
    step: STEP_MIN,
    value: 0,
    "aria-label": t("Minutes from now"),
    list: "hours",
    oninput: () => store.selectTime(Number(slider.value)),
  });
  const label = h("output", { id: "moment" }, t("now"));
  const button = (name: string, title: string, act: () => void): HTMLButtonElement =>
    h("button", { type: "button", title, onclick: act }, name, /\d/.test(name) && h("span", { class: "unseen" }, ` ${t("minutes")}`));
  const step = (by: number): void => {
    store.selectTime(Math.max(Number(slider.min), Math.min(MAX_MIN, store.inMin + by)));
  };
  byId("time").append(
    label,
    button("−5", t("Five minutes earlier"), () => step(-STEP_MIN)),
    slider,
    h("datalist", { id: "hours" }, ...[0, 60, 120, 180, 240, 300, 360].map((min) => h("option", { value: min }))),
    button("+5", t("Five minutes later"), () => step(STEP_MIN)),
    button(t("Now"), t("Back to now"), () => store.selectTime(0)),
  );
  shortcut(",", t("Time: five minutes earlier"), () => step(-STEP_MIN));
  shortcut(".", t("Time: five minutes later"), () => step(STEP_MIN));
  shortcut("<", t("Time: half an hour earlier"), () => step(-30));
  shortcut(">", t("Time: half an hour later"), () => step(30));
  shortcut("0", t("Time: now"), () => store.selectTime(0));

  const renew = (): void => {
    // The range begins at the fire's start, but at most MAX_PAST_MIN ago.
    const past = Math.min(MAX_PAST_MIN, Math.floor(store.nowS / 60 / STEP_MIN) * STEP_MIN);
    slider.min = String(-Math.max(STEP_MIN, past));
    slider.value = String(store.inMin);
    const text = moment(store.inMin);
    slider.setAttribute("aria-valuetext", text);
    setText(label, `${text} · ${clock(store.nowS + store.inMin * 60)}`);
    byId("time").classList.toggle("elsewhen", store.inMin !== 0);
  };
  store.on(["moment", "status", "fire", "telemetry"], renew);
}
