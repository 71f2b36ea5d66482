// The tour of the map, a minute long: a few steps, each of which marks a part of the page and explains it. It opens at
// the first visit, from the display settings, and for an address that ends with `tour` (of `demo`).

import { byId, fill, h } from "./dom.ts";
import { t } from "./messages.ts";

const KEY = "mission-service-tour";
const ASKED = /[#&]tour$/;
const MARK = "toured";

const isAsked = ASKED.test(location.hash);
if (isAsked) history.replaceState(null, "", location.href.replace(ASKED, "")); // not again after a reload

interface Step {
  of: string; // selector of the marked part
  title: string;
  text: string;
}

const STEPS: Step[] = [
  { of: "#top", title: t("The top bar"), text: t("The time of the mission, the burned area, and whether the data are live. If it shows NOT LIVE, use the radio.") },
  { of: "#abort", title: t("ABORT and CLEAR"), text: t("Press ABORT twice or hold it: all vehicles stop, climb and hold. CLEAR lands them all, after a confirmation.") },
  { of: "#map", title: t("The map"), text: t("Red is burned now. Each vehicle has its track and its mission; press a vehicle to choose it.") },
  { of: "#time", title: t("The time slider"), text: t("Move it to see the fire up to six hours ahead, in orange. Now returns to the present.") },
  { of: "#tools", title: t("Pens"), text: t("Draw what you see: burned, burning, unburned. The forecast and the missions follow; Undo takes it back. Note adds a text and a photo.") },
  { of: "#side", title: t("Panels"), text: t("What each vehicle does and why, orders to it, the wind, the sources of observations, and the log of everything.") },
  { of: "button.settings", title: t("Display settings"), text: t("Language, units, colours for the night or for bright sun, basemaps, and this tour.") },
];

/** Whether the tour opens by itself: asked for, or not seen in this browser. */
export const isTourDue = (): boolean => isAsked || localStorage.getItem(KEY) === null;

/** Open the tour at its first step. */
export function showTour(): void {
  const dialog = byId("tour") as HTMLDialogElement;
  const steps = STEPS.filter(({ of }) => document.querySelector(of)?.checkVisibility());
  let at = 0;
  const title = h("h2");
  const text = h("p", { "aria-live": "polite" });
  const place = h("span", { class: "place" });
  const skip = h("button", { type: "button", onclick: () => dialog.close() }, t("Skip"));
  const back = h("button", { type: "button", onclick: () => go(-1) }, t("Back"));
  const next = h("button", { type: "button", class: "primary", onclick: () => go(1) });
  const unmark = (): void => document.querySelector(`.${MARK}`)?.classList.remove(MARK);

  const go = (by: number): void => {
    at = Math.max(0, at + by);
    const step = steps[at];
    if (!step) return dialog.close();
    unmark();
    const marked = document.querySelector(step.of)!;
    marked.classList.add(MARK);
    // The dialog is in the other half of the window than the marked part.
    const { top, bottom } = marked.getBoundingClientRect();
    dialog.classList.toggle("low", (top + bottom) / 2 < innerHeight / 2);
    fill(title, step.title);
    fill(text, step.text);
    fill(place, `${at + 1} / ${steps.length}`);
    fill(next, at + 1 < steps.length ? t("Next step") : t("Done"));
    back.disabled = at === 0;
  };
  dialog.onclose = () => {
    unmark();
    localStorage.setItem(KEY, "seen");
  };
  dialog.onkeydown = ({ key }) => {
    if (key === "ArrowRight") go(1);
    else if (key === "ArrowLeft") go(-1);
  };
  fill(dialog, h("div", { class: "row head" }, title, place), text, h("div", { class: "row" }, skip, back, next));
  dialog.show(); // not modal: the abort button remains accessible
  go(0);
  next.focus();
}
