// The bar of a replay: play and pause, speed, and where in the log it is. Only in replays.

import { say, withoutRole } from "./actions.ts";
import { post, wordsOf } from "./api.ts";
import { coalesced } from "./coalesce.ts";
import { byId, fill, h, setReason, setText } from "./dom.ts";
import { shortcut } from "./keys.ts";
import type { Store } from "./store.ts";
import type { Replay } from "./types.ts";
import { counter } from "./units.ts";

const SPEEDS = ["0.5", "1", "2", "5", "10", "20", "max"];
const STEP_S = 10;
const SEEK_MS = 200; // between two places while somebody drags

export function replayBar(store: Store): void {
  const bar = byId("replay");
  const play = h("button", { type: "button", class: "play", onclick: () => toggle() });
  const speed = h("select", { "aria-label": "Speed of the replay", onchange: () => faster() });
  const slider = h("input", { type: "range", min: 0, step: 1, "aria-label": "Time in the log" });
  const words = h("output");
  const step = (by: number, name: string): HTMLButtonElement =>
    h("button", { type: "button", title: name, "aria-label": name, onclick: () => move(by) }, by < 0 ? "−10 s" : "+10 s");
  const steps = [step(-STEP_S, "Ten seconds back"), step(STEP_S, "Ten seconds forward")];
  bar.append(play, speed, steps[0]!, slider, steps[1]!, words);

  let dragged = false;
  let wantedS: number | null = null; // sought, and not yet there
  const there = (): boolean => Boolean(store.state?.replay);
  const replay = (): Replay | null => store.state?.replay ?? null;
  const lengthS = (now: Replay): number => (now.log_end_us - now.log_begin_us) / 1e6;
  const placeS = (now: Replay): number => wantedS ?? (now.log_at_us - now.log_begin_us) / 1e6;

  /**
   * Ask, and show the answer, unless the stream has sent a state meanwhile: the answer may be
   * older, and a paused replay sends no other.
   */
  const ask = async (body: object): Promise<void> => {
    const before = replay();
    try {
      const answer = await post<Replay>("replay", body);
      if (replay() === before) store.expect(without(answer));
    } catch (error) {
      say(`Replay failed: ${wordsOf(error)}`, true);
    }
  };
  const seek = coalesced(async () => {
    const toS = wantedS;
    if (toS === null) return;
    await ask({ seek_s: toS });
    if (wantedS === toS && !dragged) wantedS = null;
    renew();
  }, SEEK_MS);
  const goTo = (toS: number): void => {
    const now = replay();
    if (!now || withoutRole(store, "fly")) return;
    wantedS = Math.min(Math.max(0, toS), lengthS(now));
    renew();
    seek();
  };
  const move = (by: number): void => {
    const now = replay();
    if (now) goTo(placeS(now) + by);
  };
  const toggle = (): void => {
    const now = replay();
    if (now && !withoutRole(store, "fly")) void ask({ paused: !now.paused });
  };
  const faster = (): void => void ask({ speed: speed.value === "max" ? "max" : Number(speed.value) });

  slider.addEventListener("input", () => {
    dragged = true;
    goTo(slider.valueAsNumber);
  });
  slider.addEventListener("change", () => {
    dragged = false;
    goTo(slider.valueAsNumber);
  });
  slider.addEventListener("keydown", (event) => {
    const by = event.key === "ArrowRight" ? STEP_S : event.key === "ArrowLeft" ? -STEP_S : 0;
    if (!by) return;
    event.preventDefault();
    move(by);
  });
  shortcut("Space", "Replay: pause or continue", toggle, false, there);
  shortcut("ArrowLeft", "Replay: ten seconds back", () => move(-STEP_S), false, there);
  shortcut("ArrowRight", "Replay: ten seconds forward", () => move(STEP_S), false, there);

  const renew = (): void => {
    const now = replay();
    bar.hidden = !now;
    document.body.classList.toggle("replay", Boolean(now));
    if (!now) return;
    setText(play, now.ended && now.paused ? "Play again" : now.paused ? "▶ Play" : "Pause");
    play.title = now.paused ? "Continue (Space)" : "Pause (Space)";
    const speeds = SPEEDS.includes(String(now.speed)) ? SPEEDS : [...SPEEDS, String(now.speed)];
    if (speed.options.length !== speeds.length) {
      fill(speed, ...speeds.map((each) => h("option", { value: each }, each === "max" ? "max" : `${each}×`)));
    }
    if (document.activeElement !== speed) speed.value = String(now.speed);
    slider.max = String(Math.ceil(lengthS(now)));
    if (!dragged) slider.value = String(placeS(now));
    const place = `${counter(placeS(now))} / ${counter(lengthS(now))}`;
    slider.setAttribute("aria-valuetext", place);
    setText(words, now.seeking ? `${place} seeking …` : place);
    const reason = withoutRole(store, "fly");
    for (const control of [play, slider, ...steps]) setReason(control, reason);
    speed.disabled = reason !== "";
  };
  store.on(["replay", "status"], renew);
}

/** An answer tells of a jump before the stream does, which has to see it itself. */
function without({ jumps: _, ...rest }: Replay): Partial<Replay> {
  return rest;
}
