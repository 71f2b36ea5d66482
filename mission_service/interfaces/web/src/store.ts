// The state that the page shows, read from /state and updated by /live. Listeners are called at most
// once a frame, and four times a second while the page is hidden, because alarms must sound.

import { ask, BASE, errorText, get, Refused } from "./api.ts";
import { backoffS, EventReader, type StreamEvent } from "./live.ts";
import { t } from "./messages.ts";
import type {
  Aircraft,
  Airspace,
  Alarm,
  Burn,
  Fire,
  MapImage,
  MissionState,
  Announcement,
  FireArrival,
  LogRecord,
  Replay,
  Source,
  State,
  Status,
  Telemetry,
  Vehicle,
} from "./types.ts";
import { clock } from "./units.ts";

export type TrackPoint = [number, number, number]; // lon, lat, mission time in seconds

export type Topic =
  | "all" // a new complete state
  | "vehicle"
  | "telemetry"
  | "mission"
  | "fire"
  | "sources" // of observations
  | "aircraft" // other aircraft
  | "fire_arrivals" // the fire's arrival at people and values at risk
  | "images" // of sensors, and the selected one
  | "burn"
  | "airspace"
  | "alarms"
  | "announcements"
  | "records" // further lines of the log
  | "status"
  | "replay"
  | "link" // connection to the service
  | "measured" // the measured line
  | "preview" // the fire after a correction that waits for its confirmation
  | "chosen" // the selected vehicle
  | "moment"; // the selected time

const MAX_LINES = 500; // of announcements, and of records
const MISSED_S = 5; // a longer interval between two positions of a vehicle: the page was too slow
export const TRACK_S = 900; // longer tracks would cover the fire
const SILENT_MS = 15_000; // the service sends at least a comment each 10 s
const ANSWER_MS = 10_000; // time limit for the state, and for the begin of the stream
const HIDDEN_MS = 250;
const RATE_MS = 3000; // interval in which the rate of mission time is measured
const RATE_TOLERANCE = 0.3;

/** A replay has jumped to another time: the complete state must be read again. */
class Jumped extends Error {}

/** The key of an image, which no other image has. */
export const imageKey = ({ source, number }: MapImage): string => `${source}/${number}`;

/** Old and new lines, without repetition. */
function joined<Line extends Announcement>(before: Line[], received: Line[]): Line[] {
  const last = before.at(-1)?.id ?? 0;
  return [...before, ...received.filter((line) => line.id > last)];
}

export class Store {
  state: State | null = null;
  vehicles = new Map<string, Vehicle>();
  telemetry = new Map<string, Telemetry>();
  missions = new Map<string, MissionState>();
  tracks = new Map<string, TrackPoint[]>();
  images: MapImage[] = []; // in the order of their times
  imageKey = ""; // of the selected image; empty: the newest one
  missed = false; // the service has positions that are missing here
  chosen = "";
  inMin = 0; // the selected time, from now
  measured: [number, number][] = []; // the measured line: lat, lon
  preview: GeoJSON.Feature | null = null; // the fire after a correction that is not sent yet
  linked = false;
  lossReason = t("not connected yet");
  receivedAt = 0; // performance.now() of the last received data
  private atUs = 0;
  private advancedAt = 0; // performance.now() of the last advance of mission time
  private rateFrom: [number, number] = [0, 0]; // mission time in microseconds, and performance.now()
  private isRealTime = false;
  private listeners: { topics: Set<Topic>; act: () => void }[] = [];
  private dirty = new Set<Topic>();
  private waiting = false;
  private running: AbortController | null = null;

  /** Call `act` after a change of one of these topics, at most once a frame. */
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
    for (const listener of this.listeners) {
      if ([...topics].some((topic) => listener.topics.has(topic))) listener.act();
    }
  }

  choose(vehicle: string): void {
    if (this.chosen === vehicle) return;
    this.chosen = vehicle;
    this.changed("chosen");
  }

  /** The selected image, or the newest one. */
  get image(): MapImage | undefined {
    return this.images.find((each) => imageKey(each) === this.imageKey) ?? this.images.at(-1);
  }

  setImages(images: MapImage[]): void {
    images.sort((a, b) => a.at_us - b.at_us);
    if (images.map(imageKey).join("\n") === this.images.map(imageKey).join("\n")) return;
    this.images = images;
    if (!images.some((each) => imageKey(each) === this.imageKey)) this.imageKey = "";
    this.changed("images");
  }

  selectImage(key: string): void {
    this.imageKey = key;
    this.changed("images");
  }

  showMeasured(points: [number, number][]): void {
    this.measured = points;
    this.changed("measured");
  }

  showPreview(front: GeoJSON.Feature | null): void {
    this.preview = front;
    this.changed("preview");
  }

  selectTime(inMin: number): void {
    if (this.inMin === inMin) return;
    this.inMin = inMin;
    this.changed("moment");
  }

  /** The last received mission time in seconds. */
  get nowS(): number {
    return this.atUs / 1e6;
  }

  /** Age of the state in seconds, by the wall clock. */
  get ageS(): number {
    return this.receivedAt ? (performance.now() - this.receivedAt) / 1000 : 0;
  }

  // The service ----------------------------------------------------------------------------------

  /** Follow the service until stopped; reconnect after each loss of the connection. */
  async follow(): Promise<void> {
    this.running?.abort();
    const stop = new AbortController();
    this.running = stop;
    for (let failures = 0; !stop.signal.aborted; ) {
      const began = performance.now();
      try {
        await this.connect(stop.signal);
        this.lost(t("the service closed the connection"));
      } catch (error) {
        if (stop.signal.aborted) return;
        if (error instanceof Jumped) continue;
        this.lost(errorText(error));
        if (error instanceof Refused && error.status === 401) return;
      }
      failures = performance.now() - began > 10_000 ? 1 : failures + 1;
      await new Promise((done) => setTimeout(done, backoffS(failures) * 1000));
    }
  }

  private lost(reason: string): void {
    this.linked = false;
    this.lossReason = reason;
    this.changed("link");
  }

  private received(): void {
    this.receivedAt = performance.now();
    if (this.linked) return;
    this.linked = true;
    this.changed("link");
  }

  /** Read the state, then its changes until the connection ends. */
  private async connect(stop: AbortSignal): Promise<void> {
    this.replace(await get<State>("state", AbortSignal.any([stop, AbortSignal.timeout(ANSWER_MS)])));
    this.received();
    const silent = new AbortController();
    const ended = AbortSignal.any([stop, silent.signal]);
    const within = async <T>(limitMs: number, work: Promise<T>): Promise<T> => {
      const timer = setTimeout(() => silent.abort(new DOMException("", "TimeoutError")), limitMs);
      return work.finally(() => clearTimeout(timer));
    };
    const response = await within(ANSWER_MS, ask(`live?since=${this.state?.version ?? 0}`, { signal: ended }));
    if (!response.body) throw new Error(`${BASE}live has no body`);
    const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
    const events = new EventReader();
    try {
      for (;;) {
        const { done, value } = await within(SILENT_MS, reader.read());
        if (done) return;
        this.received();
        for (const event of events.read(value)) this.update(event);
      }
    } finally {
      void reader.cancel().catch(() => undefined);
    }
  }

  /** Replace the complete state. */
  private replace(state: State): void {
    if (state.replay?.jumps !== this.state?.replay?.jumps) this.tracks.clear(); // of another time
    this.state = state;
    [this.images, this.imageKey] = [[], ""]; // of another time, or of a service that has started again
    this.atUs = 0;
    this.vehicles = new Map(state.vehicles.map((one) => [one.vehicle, one]));
    this.missions = new Map(state.missions.map((one) => [one.vehicle, one]));
    this.telemetry = new Map();
    for (const one of state.telemetry) this.move(one);
    this.advance(state.status.at_us);
    if (!this.vehicles.has(this.chosen)) this.chosen = state.vehicles[0]?.vehicle ?? "";
    this.changed("all");
  }

  /** Apply an event of the live stream. */
  private update({ event, data }: StreamEvent): void {
    if (!this.state) return;
    const part: unknown = JSON.parse(data);
    switch (event) {
      case "vehicle":
        this.vehicles.set((part as Vehicle).vehicle, part as Vehicle);
        break;
      case "telemetry":
        this.move(part as Telemetry);
        break;
      case "mission":
        this.missions.set((part as MissionState).vehicle, part as MissionState);
        break;
      case "fire":
        this.state.fire = part as Fire;
        break;
      case "sources":
        this.state.sources = part as Source[];
        break;
      case "aircraft":
        this.state.aircraft = part as Aircraft[];
        break;
      case "fire_arrivals":
        this.state.fire_arrivals = part as FireArrival[];
        break;
      case "burn":
        this.state.burn = part as Burn | null;
        break;
      case "airspace":
        this.state.airspace = part as Airspace;
        break;
      case "alarms":
        this.state.alarms = part as Alarm[];
        break;
      case "announcements":
        this.state.announcements = joined(this.state.announcements, part as Announcement[]).slice(-MAX_LINES);
        break;
      case "records":
        this.state.records = joined(this.state.records, part as LogRecord[]).slice(-MAX_LINES);
        break;
      case "replay":
        if ((part as Replay).jumps !== this.state.replay?.jumps) throw new Jumped();
        this.state.replay = part as Replay;
        break;
      case "status":
        this.state.status = part as Status;
        this.advance(this.state.status.at_us);
        break;
      default:
        return;
    }
    this.changed(event);
  }

  /** Show the expected state of a replay until the service sends its state. */
  expect(replay: Partial<Replay>): void {
    if (!this.state?.replay) return;
    this.state.replay = { ...this.state.replay, ...replay };
    this.changed("replay");
  }

  /** Store a position and extend the track of its vehicle. */
  private move(fix: Telemetry): void {
    this.telemetry.set(fix.vehicle, fix);
    this.advance(fix.at_us);
    const track = this.tracks.get(fix.vehicle) ?? [];
    const now: TrackPoint = [fix.lon_deg, fix.lat_deg, fix.at_us / 1e6];
    // The position replaces the last point until that is `everyS` later than the point before it.
    const everyS = Math.max(1, this.telemetry.size / 10);
    if (track.length > 1 && now[2] - track.at(-2)![2] < everyS) track.pop();
    this.missed ||= now[2] - (track.at(-1)?.[2] ?? now[2]) > MISSED_S;
    track.push(now);
    while (track[0]![2] < this.nowS - TRACK_S) track.shift();
    this.tracks.set(fix.vehicle, track);
  }

  private advance(atUs: number): void {
    if (atUs <= this.atUs) return;
    const now = performance.now();
    // Compare both clocks over at least RATE_MS.
    if (!this.atUs) [this.rateFrom, this.isRealTime] = [[atUs, now], false];
    const [fromUs, from] = this.rateFrom;
    if (now - from >= RATE_MS) {
      this.isRealTime = Math.abs((atUs - fromUs) / 1000 / (now - from) - 1) < RATE_TOLERANCE;
      this.rateFrom = [atUs, now];
    }
    [this.atUs, this.advancedAt] = [atUs, now];
  }

  /** A mission time as text: of the day while mission time passes as real time, otherwise "time 1:05". */
  clockText(atS: number): string {
    if (!this.isRealTime || this.state?.replay) return t("time {clock}", { clock: clock(atS) });
    const at = new Date(Date.now() + (atS - this.nowS) * 1000);
    return `${String(at.getHours()).padStart(2, "0")}:${String(at.getMinutes()).padStart(2, "0")}`;
  }

  /** Seconds since the last advance of mission time, by the wall clock. */
  get stillS(): number {
    return this.advancedAt ? (performance.now() - this.advancedAt) / 1000 : 0;
  }
}
