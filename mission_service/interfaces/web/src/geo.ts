// Geodesy on a sphere, with errors of about a metre at the size of a fire.

import type { LonLat } from "./types.ts";

const M_PER_DEG = 111194.9266;
const RAD = Math.PI / 180;

/** The point at `distanceM` from a point, in the direction `bearingDeg` (clockwise from north). */
export function pointAt(from: LonLat, bearingDeg: number, distanceM: number): LonLat {
  const north = Math.cos(bearingDeg * RAD) * distanceM;
  const east = Math.sin(bearingDeg * RAD) * distanceM;
  return [from[0] + east / (M_PER_DEG * Math.cos(from[1] * RAD)), from[1] + north / M_PER_DEG];
}

/** An ellipse with two semi-axes as a closed ring; the direction of the first one is clockwise from north. */
export function ellipse(middle: LonLat, majorM: number, minorM: number, majorFromDeg: number): LonLat[] {
  const corners = 48;
  const ring: LonLat[] = [];
  for (let i = 0; i <= corners; i++) {
    const turn = (2 * Math.PI * (i % corners)) / corners;
    const [along, across] = [majorM * Math.cos(turn), minorM * Math.sin(turn)];
    ring.push(pointAt(middle, majorFromDeg + Math.atan2(across, along) / RAD, Math.hypot(along, across)));
  }
  return ring;
}

/** A circle as a closed ring. */
export const circle = (middle: LonLat, radiusM: number): LonLat[] => ellipse(middle, radiusM, radiusM, 0);

/** West, south, east, north of some points, at least `minM` wide and high; null without points. */
export function extentOf(points: LonLat[], minM: number): [number, number, number, number] | null {
  if (!points.length) return null;
  const [lons, lats] = [points.map(([lon]) => lon), points.map(([, lat]) => lat)];
  const [west, south] = [Math.min(...lons), Math.min(...lats)];
  const [east, north] = [Math.max(...lons), Math.max(...lats)];
  const middle: LonLat = [(west + east) / 2, (south + north) / 2];
  const [left, low] = pointAt(middle, 225, minM * Math.SQRT1_2);
  const [right, high] = pointAt(middle, 45, minM * Math.SQRT1_2);
  return [Math.min(west, left), Math.min(south, low), Math.max(east, right), Math.max(north, high)];
}

/** All points of some map features. */
export function pointsOf(data: GeoJSON.GeoJSON): LonLat[] {
  const found: LonLat[] = [];
  const collect = (value: unknown): void => {
    if (!Array.isArray(value)) return;
    if (typeof value[0] === "number") found.push([value[0], value[1] as number]);
    else for (const part of value) collect(part);
  };
  if (data.type === "FeatureCollection") for (const one of data.features) found.push(...pointsOf(one));
  else if (data.type === "Feature") return data.geometry ? pointsOf(data.geometry) : [];
  else if (data.type === "GeometryCollection") for (const one of data.geometries) found.push(...pointsOf(one));
  else collect(data.coordinates);
  return found;
}

/** A line with fewer corners; its distance from the original is at most `tolerance` (Douglas-Peucker). */
export function simplified(points: [number, number][], tolerance: number): [number, number][] {
  if (points.length < 3) return points;
  const keep = new Uint8Array(points.length);
  keep[0] = keep[points.length - 1] = 1;
  const open: [number, number][] = [[0, points.length - 1]];
  for (let span = open.pop(); span; span = open.pop()) {
    const [first, last] = span;
    let farthest = 0;
    let at = -1;
    for (let i = first + 1; i < last; i++) {
      const off = offLine(points[i]!, points[first]!, points[last]!);
      if (off > farthest) [farthest, at] = [off, i];
    }
    if (farthest > tolerance) {
      keep[at] = 1;
      open.push([first, at], [at, last]);
    }
  }
  return points.filter((_, i) => keep[i]);
}

/** A drawn loop without its crossings, which are near its start: of each, the larger part remains. */
export function uncrossed(loop: [number, number][]): [number, number][] {
  for (let ring = loop; ; ) {
    const crossing = firstCrossing(ring);
    if (!crossing) return ring;
    const [i, j, at] = crossing;
    const inner: [number, number][] = [at, ...ring.slice(i + 1, j + 1)];
    const outer: [number, number][] = [...ring.slice(0, i + 1), at, ...ring.slice(j + 1)];
    ring = Math.abs(areaOf(inner)) > Math.abs(areaOf(outer)) ? inner : outer;
  }
}

/** The first two sides i < j of a closed loop that intersect and are not adjacent, and the point. */
function firstCrossing(ring: [number, number][]): [number, number, [number, number]] | null {
  const n = ring.length;
  for (let i = 0; i < n - 2; i++) {
    for (let j = i + 2; j < n - (i === 0 ? 1 : 0); j++) {
      const at = intersection(ring[i]!, ring[i + 1]!, ring[j]!, ring[(j + 1) % n]!);
      if (at) return [i, j, at];
    }
  }
  return null;
}

type Corner = [number, number];

/** The intersection of two sides including their ends, or null. */
function intersection(a: Corner, b: Corner, c: Corner, d: Corner): Corner | null {
  const [rx, ry, sx, sy] = [b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]];
  const cross = rx * sy - ry * sx;
  if (cross === 0) return null;
  const t = ((c[0] - a[0]) * sy - (c[1] - a[1]) * sx) / cross;
  const u = ((c[0] - a[0]) * ry - (c[1] - a[1]) * rx) / cross;
  return t >= 0 && t <= 1 && u >= 0 && u <= 1 ? [a[0] + t * rx, a[1] + t * ry] : null;
}

function areaOf(ring: Corner[]): number {
  let sum = 0;
  for (const [i, [x, y]] of ring.entries()) {
    const next = ring[(i + 1) % ring.length]!;
    sum += x * next[1] - next[0] * y;
  }
  return sum / 2;
}

function offLine(p: [number, number], a: [number, number], b: [number, number]): number {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const length2 = dx * dx + dy * dy;
  const t = length2 ? Math.max(0, Math.min(1, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / length2)) : 0;
  return Math.hypot(p[0] - a[0] - t * dx, p[1] - a[1] - t * dy);
}

/** The distance between two places. */
export function distanceM([lonA, latA]: LonLat, [lonB, latB]: LonLat): number {
  const east = (lonB - lonA) * Math.cos(((latA + latB) / 2) * RAD);
  return M_PER_DEG * Math.hypot(latB - latA, east);
}
