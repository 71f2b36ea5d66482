// The abort button, always visible and red. To prevent accidental aborts it must be held for 0.7 s
// or pressed twice; Ctrl+Shift+X aborts at once.

import { showMessage } from "./actions.ts";
import { errorText, post } from "./api.ts";
import { byId, h } from "./dom.ts";
import { shortcut } from "./keys.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";

const HOLD_MS = 700;
const ARMED_MS = 4000;
const TRIES = 5;
const ANSWER_MS = 3000; // time limit of one attempt; a repeated abort does no harm

export function abortButton(store: Store): HTMLButtonElement {
  const button = h(
    "button",
    { id: "abort", type: "button", title: t("Press twice or hold: all vehicles stop, climb and hold") },
    t("ABORT"),
  );
  let armed = 0;
  let held = 0;
  let fired = false;

  const disarm = (): void => {
    clearTimeout(armed);
    armed = 0;
    button.classList.remove("armed");
    button.textContent = t("ABORT");
  };
  const fire = (): void => {
    disarm();
    button.classList.add("sent");
    void abort().finally(() => setTimeout(() => button.classList.remove("sent"), 3000));
  };
  const arm = (): void => {
    button.classList.add("armed");
    button.textContent = t("PRESS AGAIN");
    byId("announcer").textContent = t("Press again to abort");
    armed = window.setTimeout(disarm, ARMED_MS);
  };
  button.addEventListener("pointerdown", () => {
    fired = false;
    held = window.setTimeout(() => {
      fired = true;
      fire();
    }, HOLD_MS);
    button.classList.add("held");
  });
  for (const kind of ["pointerup", "pointerleave", "pointercancel"]) {
    button.addEventListener(kind, () => {
      clearTimeout(held);
      button.classList.remove("held");
      setTimeout(() => (fired = false), 50); // after the click that ends a hold
    });
  }
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  button.addEventListener("click", () => {
    if (fired) return; // the hold has sent the abort
    if (armed) fire();
    else arm();
    fired = false;
  });
  const isLive = (): boolean => !store.state?.replay;
  shortcut("Ctrl+Shift+X", t("ABORT at once: all vehicles stop, climb and hold"), fire, true, isLive);
  return button;
}

/** Send the abort; repeat it after an error, up to TRIES times. */
async function abort(): Promise<void> {
  for (let tries = 1; ; tries++) {
    try {
      showMessage(t("ABORT: sending …"), true);
      await post("abort", {}, "POST", AbortSignal.timeout(ANSWER_MS));
      showMessage(t("ABORT accepted: vehicles stop, climb and hold"), true);
      return;
    } catch (error) {
      const text = t("ABORT NOT ACCEPTED (attempt {tries}): {reason}", { tries, reason: errorText(error) });
      showMessage(t("{text}. Use the radio and the transmitter.", { text }), true);
      if (tries === TRIES) return;
      await new Promise((done) => setTimeout(done, 500));
    }
  }
}
