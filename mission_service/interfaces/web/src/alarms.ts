// Alarms: a banner until an alarm is acknowledged or cleared, and a sound. Severe alarms repeat their
// sound every few seconds; for them muting lasts two minutes. The page raises two alarms itself: lost
// service and old data.

import { createElement, Volume2, VolumeX } from "lucide";
import { lacking, showMessage } from "./actions.ts";
import { errorText, post, Refused } from "./api.ts";
import { byId, fill, h, setText } from "./dom.ts";
import { shortcut } from "./keys.ts";
import { t } from "./messages.ts";
import { whenReleased } from "./presses.ts";
import { beep, canSound, readySound } from "./sound.ts";
import type { Store } from "./store.ts";
import type { Alarm } from "./types.ts";
import { clock, duration } from "./units.ts";

const AGAIN_MS = 5000;
const MUTED_MS = 120_000;
const LOST_S = 3; // a shorter loss of the connection is not an alarm
const STILL_S = 20; // limit of the time in which mission time does not advance
const MAX_SHOWN = 3;
const SENT_EVERY_MS = 150; // the service accepts ten requests a second
const OWN = "page/"; // keys of the alarms of the page itself

export class Alarms {
  readonly button = h("button", { id: "sound", type: "button" });
  private acknowledged: Severities = new Map(); // on this page
  private sounded: Severities = new Map();
  private muted = false;
  private mutedAt = 0;
  private lostAt = 0;
  private shown = "";

  constructor(private readonly store: Store) {
    readySound(() => this.nameButton());
    this.button.addEventListener("click", () => this.mute(!this.muted));
    shortcut("m", t("Mute or unmute alarms (severe alarms for two minutes)"), () => this.mute(!this.muted));
    shortcut("k", t("Acknowledge all alarms"), () => this.acknowledge(this.current()));
    store.on(["alarms", "link"], () => this.renew());
    setInterval(() => this.renew(), 1000);
    setInterval(() => this.soundSevere(), AGAIN_MS);
    this.nameButton();
  }

  /** All active alarms: severe alarms first, then the latest. */
  current(): Alarm[] {
    const active = (this.store.state?.alarms ?? []).filter((alarm) => alarm.cleared_at_us === null);
    return [...this.own(), ...active].sort(
      (a, b) => Number(b.severity === "severe") - Number(a.severity === "severe") || b.at_us - a.at_us,
    );
  }

  /** Alarms of the page: no connection to the service, or mission time does not advance. */
  private own(): Alarm[] {
    const { store } = this;
    if (store.linked) this.lostAt = 0;
    else if (!this.lostAt) this.lostAt = performance.now();
    const lostS = this.lostAt ? (performance.now() - this.lostAt) / 1000 : 0;
    const base = { vehicle: "", severity: "severe", cleared_at_us: null, acknowledged_by: "" } as const;
    if (store.state && lostS > LOST_S) {
      const text = t("Service lost ({reason}). The data are {duration} old", { reason: store.lossReason, duration: duration(store.ageS) });
      return [{ ...base, alarm: "page/service", at_us: Math.round(this.lostAt), text }];
    }
    if (store.state && !store.state.replay && store.linked && store.stillS > STILL_S) {
      const text = t("No data on fire and vehicles for {duration}", { duration: duration(store.stillS) });
      return [{ ...base, alarm: "page/still", at_us: 0, text, severity: "warning" }];
    }
    return [];
  }

  private renew(): void {
    const current = this.current();
    for (const each of [this.acknowledged, this.sounded]) renewSeverities(each, current);
    const open = current.filter((alarm) => this.isOpen(alarm));
    const fresh = open.find((alarm) => !this.sounded.has(keyOf(alarm)));
    if (fresh) {
      for (const alarm of open) this.sounded.set(keyOf(alarm), alarm.severity);
      if (this.mayBeep(fresh.severity === "severe")) beep(fresh.severity);
    }
    whenReleased(byId("alarms"), () => this.paint(open, current));
  }

  private paint(open: Alarm[], current: Alarm[]): void {
    const element = byId("alarms");
    const keys = JSON.stringify([open, current].map((alarms) => alarms.map((alarm) => [keyOf(alarm), alarm.severity])));
    if (keys !== this.shown) {
      this.shown = keys;
      fill(element, ...open.slice(0, MAX_SHOWN).map((alarm) => this.row(alarm)));
      const more = open.length - MAX_SHOWN;
      if (more > 0) element.append(h("p", {}, t("and {more} more in the log", { more })));
      if (open.length > 1) {
        const all = h("button", { type: "button", onclick: () => this.acknowledge(open) }, t("All (K)"));
        all.setAttribute("aria-label", t("Acknowledge all"));
        element.firstElementChild?.append(all);
      }
      const quiet = current.length - open.length;
      element.classList.toggle("quiet", open.length === 0 && quiet > 0);
      if (!open.length && quiet) {
        element.append(h("p", {}, t("Still active: {alarms}", { alarms: current.map((alarm) => alarm.text).join("; ") })));
      }
    }
    // The age of the data in the texts changes without a new banner.
    for (const [i, alarm] of open.slice(0, MAX_SHOWN).entries()) {
      const label = element.children[i]?.querySelector("span");
      if (label) setText(label, alarmText(alarm));
    }
  }

  private row(alarm: Alarm): HTMLElement {
    return h(
      "div",
      { class: `alarm ${alarm.severity}` },
      h("strong", {}, alarm.severity === "severe" ? t("ALARM") : t("WARNING")),
      h("span", {}, alarmText(alarm)),
      h("button", { type: "button", onclick: () => this.acknowledge([alarm]) }, t("Acknowledge")),
    );
  }

  private acknowledge(alarms: Alarm[]): void {
    const open = alarms.filter((alarm) => this.isOpen(alarm) && !alarm.alarm.startsWith(OWN));
    for (const alarm of alarms) this.acknowledged.set(keyOf(alarm), alarm.severity);
    this.renew();
    if (!lacking(this.store, "correct")) void this.sendAcknowledged(open);
  }

  /** Send acknowledgements, so that the alarms are not sent to further people. */
  private async sendAcknowledged(alarms: Alarm[]): Promise<void> {
    for (const alarm of alarms) {
      if (!this.acknowledged.has(keyOf(alarm))) continue; // it has ended or become severe in the meantime
      try {
        await post("alarms/acknowledge", { alarm: alarm.alarm });
      } catch (error) {
        showMessage(t("The acknowledgement was not sent: {reason}", { reason: errorText(error) }), true);
        if (!(error instanceof Refused)) return;
      }
      await new Promise((done) => setTimeout(done, SENT_EVERY_MS));
    }
  }

  /** An alarm is open until it is acknowledged here, or at another station. */
  private isOpen(alarm: Alarm): boolean {
    return !alarm.acknowledged_by && !this.acknowledged.has(keyOf(alarm));
  }

  private soundSevere(): void {
    const open = this.current().some((alarm) => alarm.severity === "severe" && this.isOpen(alarm));
    if (open && this.mayBeep(true)) beep("severe");
    if (this.muted) this.nameButton();
  }

  /** Whether a sound is permitted now. */
  mayBeep(severe: boolean): boolean {
    if (this.store.state?.replay) return false; // the alarms are of the logged flight
    return !this.muted || (severe && performance.now() - this.mutedAt > MUTED_MS);
  }

  private mute(muted: boolean): void {
    this.muted = muted;
    this.mutedAt = performance.now();
    this.nameButton();
  }

  private nameButton(): void {
    const severeOnly = this.muted && performance.now() - this.mutedAt > MUTED_MS;
    const mode = !canSound() ? t("Sound off: press") : !this.muted ? t("Sound on") : severeOnly ? t("Severe only") : t("Muted 2 min");
    if (this.button.dataset.mode !== mode) {
      this.button.dataset.mode = mode;
      const icon = canSound() && !this.muted ? Volume2 : VolumeX;
      fill(this.button, createElement(icon, { "aria-hidden": "true" }), h("span", {}, mode));
    }
    this.button.title = t("Mute alarms (M); severe alarms sound again after two minutes");
    this.button.setAttribute("aria-pressed", String(this.muted));
  }
}

type Severities = Map<string, Alarm["severity"]>; // by alarm and start time

const keyOf = (alarm: Alarm): string => `${alarm.alarm}@${alarm.at_us}`;

/** Remove alarms that have ended or become severe; an alarm that has become a warning stays. */
function renewSeverities(severities: Severities, current: Alarm[]): void {
  const now = new Map(current.map((alarm) => [keyOf(alarm), alarm.severity]));
  for (const [key, before] of severities) {
    const severity = now.get(key);
    if (!severity || (severity === "severe" && before !== "severe")) severities.delete(key);
    else severities.set(key, severity);
  }
}

function alarmText(alarm: Alarm): string {
  return alarm.alarm.startsWith("page/") ? alarm.text : t("{alarm} (since {clock})", { alarm: alarm.text, clock: clock(alarm.at_us / 1e6) });
}
