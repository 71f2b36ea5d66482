// The replay bar: play and pause, speed, and position in the log. Visible only in replays.

import { showMessage, withoutRole } from "./actions.ts";
import { errorText, post } from "./api.ts";
import { coalesced } from "./coalesce.ts";
import { byId, fill, h, setReason, setText } from "./dom.ts";
import { shortcut } from "./keys.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";
import type { Replay } from "./types.ts";
import { counter } from "./units.ts";

const SPEEDS = ["0.5", "1", "2", "5", "10", "20", "max"];
const STEP_S = 10;
const SEEK_MS = 200; // between two requests while the slider is dragged

export function replayBar(store: Store): void {
  const bar = byId("replay");
  const play = h("button", { type: "button", class: "play", onclick: () => toggle() });
  const speed = h("select", { "aria-label": t("Speed of the replay"), onchange: () => setSpeed() });
  const slider = h("input", { type: "range", min: 0, step: 1, "aria-label": t("Time in the log") });
  const label = h("output");
  const step = (by: number, name: string): HTMLButtonElement =>
    h("button", { type: "button", title: name, "aria-label": name, onclick: () => skip(by) }, by < 0 ? "−10 s" : "+10 s");
  const steps = [step(-STEP_S, t("Ten seconds back")), step(STEP_S, t("Ten seconds forward"))];
  bar.append(play, speed, steps[0]!, slider, steps[1]!, label);

  let dragged = false;
  let targetS: number | null = null; // requested position, not reached yet
  const isReplay = (): boolean => Boolean(store.state?.replay);
  const replay = (): Replay | null => store.state?.replay ?? null;
  const lengthS = (now: Replay): number => (now.log_end_us - now.log_begin_us) / 1e6;
  const positionS = (now: Replay): number => targetS ?? (now.log_at_us - now.log_begin_us) / 1e6;

  /**
   * Send a request and show its reply, because a paused replay sends no state; the reply may be
   * older than a state that the stream has sent meanwhile.
   */
  const request = async (body: object): Promise<void> => {
    const before = replay();
    try {
      const answer = await post<Replay>("replay", body);
      if (replay() === before) store.expect(withoutJumps(answer));
    } catch (error) {
      showMessage(t("Replay failed: {reason}", { reason: errorText(error) }), true);
    }
  };
  const seek = coalesced(async () => {
    const toS = targetS;
    if (toS === null) return;
    await request({ seek_s: toS });
    if (targetS === toS && !dragged) targetS = null;
    renew();
  }, SEEK_MS);
  const goTo = (toS: number): void => {
    const now = replay();
    if (!now || withoutRole(store, "fly")) return;
    targetS = Math.min(Math.max(0, toS), lengthS(now));
    renew();
    seek();
  };
  const skip = (by: number): void => {
    const now = replay();
    if (now) goTo(positionS(now) + by);
  };
  const toggle = (): void => {
    const now = replay();
    if (now && !withoutRole(store, "fly")) void request({ paused: !now.paused });
  };
  const setSpeed = (): void => void request({ speed: speed.value === "max" ? "max" : Number(speed.value) });

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
    skip(by);
  });
  shortcut("Space", t("Replay: pause or continue"), toggle, false, isReplay);
  shortcut("ArrowLeft", t("Replay: ten seconds back"), () => skip(-STEP_S), false, isReplay);
  shortcut("ArrowRight", t("Replay: ten seconds forward"), () => skip(STEP_S), false, isReplay);

  const renew = (): void => {
    const now = replay();
    bar.hidden = !now;
    document.body.classList.toggle("replay", Boolean(now));
    if (!now) return;
    setText(play, now.ended && now.paused ? t("Play again") : now.paused ? t("▶ Play") : t("Pause"));
    play.title = now.paused ? t("Continue (Space)") : t("Pause (Space)");
    const speeds = SPEEDS.includes(String(now.speed)) ? SPEEDS : [...SPEEDS, String(now.speed)];
    if (speed.options.length !== speeds.length) {
      fill(speed, ...speeds.map((each) => h("option", { value: each }, each === "max" ? t("max") : `${each}×`)));
    }
    if (document.activeElement !== speed) speed.value = String(now.speed);
    slider.max = String(Math.ceil(lengthS(now)));
    if (!dragged) slider.value = String(positionS(now));
    const position = `${counter(positionS(now))} / ${counter(lengthS(now))}`;
    slider.setAttribute("aria-valuetext", position);
    setText(label, now.seeking ? t("{position} seeking …", { position }) : position);
    const reason = withoutRole(store, "fly");
    for (const control of [play, slider, ...steps]) setReason(control, reason);
    speed.disabled = reason !== "";
  };
  store.on(["replay", "status"], renew);
}

/** A reply without `jumps`: the store must detect a jump in the stream, which sends it later. */
function withoutJumps({ jumps: _, ...rest }: Replay): Partial<Replay> {
  return rest;
}
