// Plans that wait for an operator's decision: a button in the top bar that counts them and opens the first, and a
// sound for each new plan, repeated while plans wait.

import type { Alarms } from "./alarms.ts";
import { h, setText } from "./dom.ts";
import { shortcut } from "./keys.ts";
import { t } from "./messages.ts";
import { beep } from "./sound.ts";
import type { Store } from "./store.ts";

const AGAIN_MS = 30_000;

interface Waiting {
  vehicle: string; // empty: the plan of a burn
  hash: string;
}

/** All plans that wait: missions of vehicles, and the plan of a burn. */
function waitingIn(store: Store): Waiting[] {
  const found: Waiting[] = [];
  for (const { vehicle, proposed } of store.missions.values()) {
    if (proposed) found.push({ vehicle, hash: proposed.mission_hash });
  }
  const burn = store.state?.burn;
  if (burn?.plan_hash && !burn.guidance.approved_by) found.push({ vehicle: "", hash: burn.plan_hash });
  return found;
}

/** Make the button; `open` opens a panel by its key. */
export function waitingButton(store: Store, alarms: Alarms, open: (panel: string) => void): HTMLButtonElement {
  const [count, noun, verb] = [h("span"), h("span", { class: "wide" }), h("span")];
  const button = h("button", { id: "waiting", type: "button", hidden: true }, count, noun, verb);
  const isLive = (): boolean => !store.state?.replay;
  let known = new Set<string>();
  let soundedAt = 0;

  const show = (): void => {
    const [first] = waitingIn(store);
    if (!first) return;
    if (first.vehicle) store.choose(first.vehicle);
    open(first.vehicle ? "vehicles" : "burn");
    requestAnimationFrame(() => document.querySelector("#side .question, #panel-burn .figures")?.scrollIntoView({ block: "center" }));
  };
  const renew = (): void => {
    const waiting = isLive() ? waitingIn(store) : [];
    button.hidden = waiting.length === 0;
    setText(count, String(waiting.length));
    setText(noun, ` ${t("{count, plural, one {plan} other {plans}}", { count: waiting.length })}`);
    setText(verb, ` ${t("{count, plural, one {waits} other {wait}}", { count: waiting.length })}`);
    const names = waiting.map(({ vehicle }) => vehicle || t("burn")).join(", ");
    button.title = t("A decision is needed: {names} (W)", { names });
    const isNew = waiting.some(({ hash }) => !known.has(hash));
    const isDue = waiting.length > 0 && performance.now() - soundedAt > AGAIN_MS;
    known = new Set(waiting.map(({ hash }) => hash));
    if ((isNew || isDue) && alarms.mayBeep(false)) {
      soundedAt = performance.now();
      beep("info");
    }
  };
  button.addEventListener("click", show);
  shortcut("w", t("Show the plan that waits for a decision"), show);
  store.on(["mission", "burn", "status"], renew);
  return button;
}
