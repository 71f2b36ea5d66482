// Values as text, in the chosen units: metric (m, km, m/s, ha), US (ft, mi, mph, acres) or aviation (ft, NM, kt, acres).
// Times as h:min. The service has metric units only.

import { decimal, t } from "./messages.ts";
import { chosenUnits } from "./preferences.ts";

interface Unit {
  name: string;
  si: number; // metres, square metres or metres a second
}

const FOOT = { name: "ft", si: 0.3048 };
const ACRE = { name: t("acres"), si: 4046.8564224 };
const LENGTHS = { metric: { name: "m", si: 1 }, us: FOOT, aviation: FOOT };
const DISTANCES = { metric: { name: "km", si: 1000 }, us: { name: "mi", si: 1609.344 }, aviation: { name: "NM", si: 1852 } };
const SPEEDS = {
  metric: { name: "m/s", si: 1 }, us: { name: "mph", si: 0.44704 }, aviation: { name: "kt", si: 1852 / 3600 },
};
const AREAS = { metric: { name: "ha", si: 10_000 }, us: ACRE, aviation: ACRE };
const FAR = 0.5; // of a distance's unit; shorter lines are lengths
const TENTHS_BELOW = 10;

type Optional = number | null | undefined;

const isValue = (value: Optional): value is number => Number.isFinite(value);

function text(value: number, unit: Unit, digits: number): string {
  return `${decimal(value / unit.si, digits)} ${unit.name}`;
}

const tenths = (value: number, unit: Unit): number => (Math.abs(value / unit.si) < TENTHS_BELOW ? 1 : 0);

/** A height or a short length: "120 m", "394 ft". */
export const length = (m: Optional): string => (isValue(m) ? text(m, LENGTHS[chosenUnits()], 0) : "–");

/** A height above or below something else: "+120 m", "−394 ft". */
export const difference = (m: number): string => `${m < 0 ? "−" : "+"}${length(Math.abs(m))}`;

/** A standard deviation of a position: "± 0.4 m". */
export const accuracy = (m: Optional): string =>
  isValue(m) ? `± ${text(m, LENGTHS[chosenUnits()], tenths(m, LENGTHS[chosenUnits()]))}` : "–";

/** Heights above ground and above mean sea level: "394 ft AGL". */
export const heightAgl = (m: Optional): string => t("{length} AGL", { length: length(m) });
export const heightMsl = (m: Optional): string => t("{length} MSL", { length: length(m) });

/** A distance: "850 m", "1.2 km", "0.7 NM". */
export function distance(m: Optional): string {
  if (!isValue(m)) return "–";
  const far = DISTANCES[chosenUnits()];
  return m < FAR * far.si || (chosenUnits() === "metric" && m < far.si) ? length(m) : text(m, far, tenths(m, far));
}

/** An area: "12.3 ha", "30 acres". */
export function area(m2: Optional): string {
  const unit = AREAS[chosenUnits()];
  return isValue(m2) ? text(m2, unit, tenths(m2, unit)) : "–";
}

/** A speed: "12 m/s", "9.1 kt". */
export function speed(mS: Optional): string {
  const unit = SPEEDS[chosenUnits()];
  return isValue(mS) ? text(mS, unit, tenths(mS, unit)) : "–";
}

/** The unit of speeds, for fields: its name, and its size in metres a second. */
export const speedUnit = (): Unit => SPEEDS[chosenUnits()];

/** Radii of range rings in metres, round in the chosen units, the largest at most `maxM`. */
export function ringRadii(maxM: number): number[] {
  const RINGS = 4;
  const unit = DISTANCES[chosenUnits()].si;
  const steps = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 20].map((each) => each * unit);
  const step = steps.filter((each) => each * RINGS <= maxM).at(-1) ?? steps[0]!;
  return Array.from({ length: RINGS }, (_, i) => step * (i + 1));
}

/** Mission time as h:min: "1:05". */
export function clock(atS: number): string {
  const minutes = Math.floor(Math.abs(atS) / 60);
  return `${atS < 0 ? "−" : ""}${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}`;
}

/** A time of the day as h:min, of this device's time zone or UTC: "14:05". */
export function timeOfDay(unixMs: number, isUtc: boolean): string {
  const at = new Date(unixMs);
  const [hours, minutes] = isUtc ? [at.getUTCHours(), at.getUTCMinutes()] : [at.getHours(), at.getMinutes()];
  return `${String(hours).padStart(2, "0")}:${String(minutes).padStart(2, "0")}`;
}

/** A time in a log: "1:05" (min:s), "1:02:05". */
export function counter(s: number): string {
  const whole = Math.max(0, Math.floor(s));
  const [hours, minutes] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60];
  const two = (value: number): string => String(value).padStart(2, "0");
  return hours ? `${hours}:${two(minutes)}:${two(whole % 60)}` : `${minutes}:${two(whole % 60)}`;
}

/** A duration: "42 s", "3 min 20 s", "2 h 5 min". */
export function duration(s: Optional): string {
  if (!isValue(s)) return "–";
  const whole = Math.round(s);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return whole % 60 ? t("{minutes} min {seconds} s", { minutes: Math.floor(whole / 60), seconds: whole % 60 }) : t("{minutes} min", { minutes: whole / 60 });
  const minutes = Math.round(whole / 60);
  return t("{hours} h {minutes} min", { hours: Math.floor(minutes / 60), minutes: minutes % 60 });
}

/** The time of the slider: "now", "forecast +45 min", "past, 30 min ago". */
export function moment(inMin: number): string {
  if (inMin === 0) return t("now");
  const size = Math.abs(inMin);
  const text = size < 60 ? t("{minutes} min", { minutes: size }) : t("{hours} h {minutes} min", { hours: Math.floor(size / 60), minutes: String(size % 60).padStart(2, "0") });
  return inMin > 0 ? t("forecast +{time}", { time: text }) : t("past, {time} ago", { time: text });
}

/** The name of a direction, one of eight: "NE". */
export function compass(deg: number): string {
  const names = [t("N"), t("NE"), t("E"), t("SE"), t("S"), t("SW"), t("W"), t("NW")];
  return names[Math.round((((deg % 360) + 360) % 360) / 45) % 8] ?? "";
}
