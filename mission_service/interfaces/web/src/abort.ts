// The abort: one red button that is always there. It is held for a moment or pressed twice, so that
// nobody aborts by brushing it; Ctrl+Shift+X aborts at once.

import { say } from "./actions.ts";
import { post, wordsOf } from "./api.ts";
import { byId, h } from "./dom.ts";
import { shortcut } from "./keys.ts";
import type { Store } from "./store.ts";

const HOLD_MS = 700;
const ARMED_MS = 4000;
const TRIES = 5;

export function abortButton(store: Store): HTMLButtonElement {
  const button = h(
    "button",
    { id: "abort", type: "button", title: "Press twice or hold: all vehicles stop, climb and hold" },
    "ABORT",
  );
  let armed = 0;
  let held = 0;
  let fired = false;

  const rest = (): void => {
    clearTimeout(armed);
    armed = 0;
    button.classList.remove("armed");
    button.textContent = "ABORT";
  };
  const fire = (): void => {
    rest();
    fired = true;
    button.classList.add("sent");
    void abort().finally(() => setTimeout(() => button.classList.remove("sent"), 3000));
  };
  const arm = (): void => {
    button.classList.add("armed");
    button.textContent = "PRESS AGAIN";
    byId("aloud").textContent = "Press again to abort";
    armed = window.setTimeout(rest, ARMED_MS);
  };
  button.addEventListener("pointerdown", () => {
    fired = false;
    held = window.setTimeout(fire, HOLD_MS);
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
    if (fired) return; // was held long enough
    if (armed) fire();
    else arm();
    fired = false;
  });
  const flies = (): boolean => !store.state?.replay;
  shortcut("Ctrl+Shift+X", "ABORT at once: all vehicles stop, climb and hold", fire, true, flies);
  return button;
}

/** Tell it until it is taken: a lost request must not be a lost abort. */
async function abort(): Promise<void> {
  for (let tries = 1; ; tries++) {
    try {
      say("ABORT: sending …", true);
      await post("abort");
      say("ABORT accepted: vehicles stop, climb and hold", true);
      return;
    } catch (error) {
      say(`ABORT NOT ACCEPTED (try ${tries}): ${wordsOf(error)}. Use the radio and the transmitter.`, true);
      if (tries === TRIES) return;
      await new Promise((done) => setTimeout(done, 500));
    }
  }
}
