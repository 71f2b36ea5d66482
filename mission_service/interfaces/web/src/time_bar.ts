// The slider of time: what was, is and is expected to be burned.

import { byId, h, setText } from "./dom.ts";
import { shortcut } from "./keys.ts";
import type { Store } from "./store.ts";
import { clock, moment } from "./units.ts";

const STEP_MIN = 5;
const MAX_MIN = 360; // as far as the service forecasts
const MAX_PAST_MIN = 180;

export function timeBar(store: Store): void {
  const slider = h("input", {
    type: "range",
    min: -60,
    max: MAX_MIN,
    step: STEP_MIN,
    value: 0,
    "aria-label": "Minutes from now",
    list: "hours",
    oninput: () => store.look(Number(slider.value)),
  });
  const words = h("output", { id: "moment" }, "now");
  const button = (name: string, title: string, act: () => void): HTMLButtonElement =>
    h("button", { type: "button", title, "aria-label": title, onclick: act }, name);
  const step = (by: number): void => {
    const least = Number(slider.min);
    store.look(Math.max(least, Math.min(MAX_MIN, store.inMin + by)));
  };
  byId("time").append(
    words,
    button("−5", "Five minutes earlier", () => step(-STEP_MIN)),
    slider,
    h("datalist", { id: "hours" }, ...[0, 60, 120, 180, 240, 300, 360].map((min) => h("option", { value: min }))),
    button("+5", "Five minutes later", () => step(STEP_MIN)),
    button("Now", "Back to now", () => store.look(0)),
  );
  shortcut(",", "Time: five minutes earlier", () => step(-STEP_MIN));
  shortcut(".", "Time: five minutes later", () => step(STEP_MIN));
  shortcut("<", "Time: half an hour earlier", () => step(-30));
  shortcut(">", "Time: half an hour later", () => step(30));
  shortcut("0", "Time: now", () => store.look(0));

  const renew = (): void => {
    // The past reaches back to the fire's beginning, and not too far for the slider.
    const past = Math.min(MAX_PAST_MIN, Math.floor(store.nowS / 60 / STEP_MIN) * STEP_MIN);
    slider.min = String(-Math.max(STEP_MIN, past));
    slider.value = String(store.inMin);
    const text = moment(store.inMin);
    slider.setAttribute("aria-valuetext", text);
    setText(words, `${text} · ${clock(store.nowS + store.inMin * 60)}`);
    byId("time").classList.toggle("elsewhen", store.inMin !== 0);
  };
  store.on(["moment", "status", "fire"], renew);
  store.on(["telemetry"], renew);
}
