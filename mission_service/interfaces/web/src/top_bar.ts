// The top bar: scenario, mission time, burned area, connection to the service, and abort.

import { abortButton } from "./abort.ts";
import type { Alarms } from "./alarms.ts";
import { clearButton } from "./clearing.ts";
import { byId, fill, h, setText } from "./dom.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";
import type { Replay } from "./types.ts";
import { area, clock, timeOfDay } from "./units.ts";

const STALE_S = 3;

/** The name of the first log, and the number of the others. */
const logsOf = ({ logs }: Replay): string => `${logs[0]}${logs.length > 1 ? ` + ${logs.length - 1}` : ""}`;

export function topBar(store: Store, alarms: Alarms, waiting: HTMLElement, help: () => void): void {
  const badge = h("strong", { class: "badge", hidden: true });
  const name = h("strong", { class: "name" });
  const time = h("span", { class: "clock", title: t("Mission time, h:min") });
  const local = h("span");
  const utc = h("span");
  const day = h("span", { class: "clock", title: t("Local time and UTC") }, local, h("span", { class: "wide" }, ` ${t("local")}`), " · ", utc);
  const size = h("span", { class: "size" });
  const link = h("span", { class: "link", role: "status" });
  const ready = h("span", { class: "ready" });
  fill(
    byId("top"),
    badge,
    name,
    time,
    day,
    size,
    link,
    ready,
    h("span", { class: "gap" }),
    waiting,
    alarms.button,
    h("button", { type: "button", class: "help", title: t("Keyboard shortcuts (?)"), "aria-label": t("Help"), onclick: help }, "?"),
    clearButton(store),
    abortButton(store),
  );
  const renew = (): void => {
    const { state } = store;
    setText(name, state?.status.scenario ?? t("Mission service"));
    setText(time, state ? t("Time {clock}", { clock: clock(store.nowS) }) : "");
    day.hidden = !state || Boolean(state.replay); // of a replay mission time only
    setText(local, timeOfDay(Date.now(), false));
    setText(utc, `${timeOfDay(Date.now(), true)}Z`);
    setText(size, state ? t("Fire {area}", { area: area(state.fire.area_ha * 1e4) }) : "");
    const old = store.ageS > STALE_S && !store.linked;
    const replay = state?.replay ?? null;
    badge.hidden = !replay;
    setText(badge, replay ? t("REPLAY {logs}", { logs: logsOf(replay) }) : "");
    badge.title = replay ? t("Replay of a logged flight: {logs}", { logs: replay.logs.join(", ") }) : "";
    setText(link, store.linked ? (replay ? "" : t("● live")) : old ? t("○ NOT LIVE, {seconds} s old", { seconds: Math.round(store.ageS) }) : t("○ NOT LIVE"));
    link.classList.toggle("lost", !store.linked);
    const notReady = state?.status.not_ready ?? [];
    setText(ready, notReady.length ? t("Not ready: {reason}", { reason: notReady[0] ?? "" }) : "");
    ready.title = notReady.join("; ");
    document.title = state ? `${replay ? `${t("REPLAY")} · ` : ""}${t("{scenario} · fire map", { scenario: state.status.scenario })}` : t("Fire map");
  };
  store.on(["status", "fire", "link", "telemetry"], renew);
  setInterval(renew, 1000);
  renew();
}
