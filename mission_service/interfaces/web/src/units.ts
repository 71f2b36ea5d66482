// Values as text: metric and US units together, times as h:min.

const FT_PER_M = 1 / 0.3048;
const M2_PER_ACRE = 4046.8564224;

export const feet = (metres: number): number => metres * FT_PER_M;

type Optional = number | null | undefined;

const isValue = (value: Optional): value is number => Number.isFinite(value);

/** A height or a short distance: "120 m (394 ft)". */
export const metres = (m: Optional): string =>
  isValue(m) ? `${Math.round(m)} m (${Math.round(feet(m))} ft)` : "–";

/** A distance; from 1 km in kilometres and miles: "1.2 km (0.7 mi)". */
export function distance(m: Optional): string {
  if (!isValue(m) || m < 1000) return metres(m);
  return `${(m / 1000).toFixed(1)} km (${(m / 1609.344).toFixed(1)} mi)`;
}

/** An area: "12.3 ha (30 acres)". */
export function area(m2: Optional): string {
  if (!isValue(m2)) return "–";
  const rounded = (value: number): string => (value < 10 ? value.toFixed(1) : String(Math.round(value)));
  return `${rounded(m2 / 1e4)} ha (${rounded(m2 / M2_PER_ACRE)} acres)`;
}

/** A speed: "12 m/s (27 mph)". */
export const speed = (mS: Optional): string =>
  isValue(mS) ? `${mS.toFixed(mS < 10 ? 1 : 0)} m/s (${Math.round(mS * 2.2369363)} mph)` : "–";

/** Mission time as h:min: "1:05". */
export function clock(atS: number): string {
  const minutes = Math.floor(Math.abs(atS) / 60);
  return `${atS < 0 ? "−" : ""}${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}`;
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
  if (whole < 3600) return whole % 60 ? `${Math.floor(whole / 60)} min ${whole % 60} s` : `${whole / 60} min`;
  const minutes = Math.round(whole / 60);
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** The time of the slider: "now", "forecast +45 min", "past, 30 min ago". */
export function moment(inMin: number): string {
  if (inMin === 0) return "now";
  const size = Math.abs(inMin);
  const text = size < 60 ? `${size} min` : `${Math.floor(size / 60)} h ${String(size % 60).padStart(2, "0")} min`;
  return inMin > 0 ? `forecast +${text}` : `past, ${text} ago`;
}

/** The name of a direction, one of eight: "NE". */
export function compass(deg: number): string {
  const names = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"];
  return names[Math.round((((deg % 360) + 360) % 360) / 45) % 8] ?? "N";
}
