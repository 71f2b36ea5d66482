// The one picture that the page shows: filled by /state, kept by /live. Changes are told at most
// once a frame, and at least four times a second while the page is hidden (alarms must be heard).

import { ask, BASE, get, Refused, wordsOf } from "./api.ts";
import { backoffS, EventReader, type StreamEvent } from "./live.ts";
import type {
  Alarm,
  Burn,
  Fire,
  MissionState,
  Announcement,
  Replay,
  State,
  Status,
  Telemetry,
  Vehicle,
} from "./types.ts";

export type TrackPoint = [number, number, number]; // lon, lat, mission time in seconds

export type Topic =
  | "all" // a new picture as a whole
  | "vehicle"
  | "telemetry"
  | "mission"
  | "fire"
  | "burn"
  | "alarms"
  | "announcements"
  | "status"
  | "replay"
  | "link" // whether the service is heard
  | "chosen" // the vehicle that is looked at
  | "moment"; // the time that is looked at

const MAX_ANNOUNCEMENTS = 200;
const MISSED_S = 5; // between two places of a vehicle: this page was too slow for more
export const TRACK_S = 900; // longer ones hide the fire
const SILENT_MS = 15_000; // the service says something each 10 s
const HIDDEN_MS = 250;

/** A replay is at another moment: the whole picture is to be asked for. */
class Jumped extends Error {}

/** Old and new lines, each once. */
function joined(before: Announcement[], told: Announcement[]): Announcement[] {
  const last = before.at(-1)?.id ?? 0;
  return [...before, ...told.filter((line) => line.id > last)];
}

export class Store {
  state: State | null = null;
  vehicles = new Map<string, Vehicle>();
  telemetry = new Map<string, Telemetry>();
  missions = new Map<string, MissionState>();
  tracks = new Map<string, TrackPoint[]>();
  missed = false; // places that the service knows and this page does not
  chosen = "";
  inMin = 0; // the time looked at, from now
  linked = false;
  why = "not connected yet";
  heardAt = 0; // performance.now() when the service was last heard
  private atUs = 0;
  private atHeard = 0;
  private listeners: { topics: Set<Topic>; act: () => void }[] = [];
  private dirty = new Set<Topic>();
  private waiting = false;
  private running: AbortController | null = null;

  /** Call `act` after any of these changed, once a frame at most. */
  on(topics: Topic[], act: () => void): void {
    this.listeners.push({ topics: new Set<Topic>([...topics, "all"]), act });
  }

  changed(topic: Topic): void {
    this.dirty.add(topic);
    if (this.waiting) return;
    this.waiting = true;
    if (document.hidden) setTimeout(() => this.flush(), HIDDEN_MS);
    else requestAnimationFrame(() => this.flush());
  }

  private flush(): void {
    const topics = this.dirty;
    this.dirty = new Set();
    this.waiting = false;
    for (const { topics: wanted, act } of this.listeners) {
      if ([...topics].some((topic) => wanted.has(topic))) act();
    }
  }

  choose(vehicle: string): void {
    if (this.chosen === vehicle) return;
    this.chosen = vehicle;
    this.changed("chosen");
  }

  look(inMin: number): void {
    if (this.inMin === inMin) return;
    this.inMin = inMin;
    this.changed("moment");
  }

  /** Mission time in seconds, as last told. */
  get nowS(): number {
    return this.atUs / 1e6;
  }

  /** How old the picture is, by the wall clock. */
  get ageS(): number {
    return this.heardAt ? (performance.now() - this.heardAt) / 1000 : 0;
  }

  // The service ----------------------------------------------------------------------------------

  /** Follow the service until stopped; every loss of it is followed by another try. */
  async follow(): Promise<void> {
    this.running?.abort();
    const stop = new AbortController();
    this.running = stop;
    for (let failures = 0; !stop.signal.aborted; ) {
      const began = performance.now();
      try {
        await this.once(stop.signal);
        this.lost("the service closed the connection");
      } catch (error) {
        if (stop.signal.aborted) return;
        if (error instanceof Jumped) continue;
        this.lost(wordsOf(error));
        if (error instanceof Refused && error.status === 401) return;
      }
      failures = performance.now() - began > 10_000 ? 1 : failures + 1;
      await new Promise((done) => setTimeout(done, backoffS(failures) * 1000));
    }
  }

  private lost(why: string): void {
    this.linked = false;
    this.why = why;
    this.changed("link");
  }

  private heard(): void {
    this.heardAt = performance.now();
    if (this.linked) return;
    this.linked = true;
    this.changed("link");
  }

  private async once(stop: AbortSignal): Promise<void> {
    this.whole(await get<State>("state", stop));
    this.heard();
    const silent = new AbortController();
    const ended = AbortSignal.any([stop, silent.signal]);
    const response = await ask(`live?since=${this.state?.version ?? 0}`, { signal: ended });
    if (!response.body) throw new Error(`${BASE}live has no body`);
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    const events = new EventReader();
    let timer = 0;
    try {
      for (;;) {
        timer = window.setTimeout(() => silent.abort(), SILENT_MS);
        const { done, value } = await reader.read();
        clearTimeout(timer);
        if (done) return;
        this.heard();
        for (const event of events.take(value)) this.take(event);
      }
    } finally {
      clearTimeout(timer);
      void reader.cancel().catch(() => undefined);
    }
  }

  /** A picture as a whole takes the place of what was. */
  private whole(state: State): void {
    if (state.replay?.jumps !== this.state?.replay?.jumps) this.tracks.clear(); // of the future
    this.state = state;
    this.atUs = 0;
    this.vehicles = new Map(state.vehicles.map((one) => [one.vehicle, one]));
    this.missions = new Map(state.missions.map((one) => [one.vehicle, one]));
    this.telemetry = new Map();
    for (const one of state.telemetry) this.moved(one);
    this.time(state.status.at_us);
    if (!this.vehicles.has(this.chosen)) this.chosen = state.vehicles[0]?.vehicle ?? "";
    this.changed("all");
  }

  private take({ event, data }: StreamEvent): void {
    if (!this.state) return;
    const told: unknown = JSON.parse(data);
    switch (event) {
      case "vehicle":
        this.vehicles.set((told as Vehicle).vehicle, told as Vehicle);
        break;
      case "telemetry":
        this.moved(told as Telemetry);
        break;
      case "mission":
        this.missions.set((told as MissionState).vehicle, told as MissionState);
        break;
      case "fire":
        this.state.fire = told as Fire;
        break;
      case "burn":
        this.state.burn = told as Burn | null;
        break;
      case "alarms":
        this.state.alarms = told as Alarm[];
        break;
      case "announcements":
        this.state.announcements = joined(this.state.announcements, told as Announcement[]).slice(-MAX_ANNOUNCEMENTS);
        break;
      case "replay": {
        const jumped = (told as Replay).jumps !== this.state.replay?.jumps;
        if (jumped) throw new Jumped();
        this.state.replay = told as Replay;
        break;
      }
      case "status":
        this.state.status = told as Status;
        this.time(this.state.status.at_us);
        break;
      default:
        return;
    }
    this.changed(event);
  }

  /** Another try of what a replay was told: shown until the service says how it is. */
  expect(replay: Partial<Replay>): void {
    if (!this.state?.replay) return;
    this.state.replay = { ...this.state.replay, ...replay };
    this.changed("replay");
  }

  private moved(here: Telemetry): void {
    this.telemetry.set(here.vehicle, here);
    this.time(here.at_us);
    const track = this.tracks.get(here.vehicle) ?? [];
    const now: TrackPoint = [here.lon_deg, here.lat_deg, here.at_us / 1e6];
    // The last point moves on with the vehicle until it is far enough from the one before.
    const everyS = Math.max(1, this.telemetry.size / 10);
    if (track.length > 1 && now[2] - track.at(-2)![2] < everyS) track.pop();
    this.missed ||= now[2] - (track.at(-1)?.[2] ?? now[2]) > MISSED_S;
    track.push(now);
    while (track[0]![2] < this.nowS - TRACK_S) track.shift();
    this.tracks.set(here.vehicle, track);
  }

  private time(atUs: number | undefined): void {
    if (atUs !== undefined && atUs > this.atUs) {
      this.atUs = atUs;
      this.atHeard = performance.now();
    }
  }

  /** Seconds by the wall clock since mission time last moved. */
  get stillS(): number {
    return this.atHeard ? (performance.now() - this.atHeard) / 1000 : 0;
  }
}
