// Messages of the service, described in docs/api.md and /api/v1/openapi.json. Times are mission time.

export type LonLat = [number, number];
export type Role = "look" | "observe" | "correct" | "fly" | "approve";
export type Level = "info" | "warning" | "severe";

export interface Telemetry {
  at_us: number;
  vehicle: string;
  lat_deg: number;
  lon_deg: number;
  altitude_amsl_m: number;
  altitude_relative_m: number;
  height_agl_m: number | null;
  heading_deg: number;
  ground_speed_m_s: number;
  track_deg: number;
}

export interface Orbit {
  lat_deg: number;
  lon_deg: number;
  altitude_amsl_m: number;
  radius_m: number; // negative: anticlockwise
  view_width_m: number; // width of the camera's coverage along the orbit
}

export interface Check {
  name: string;
  state: "pass" | "fail" | "unknown";
  text: string; // figures and remedy
}

export interface Link {
  link: string; // its address
  state: "waiting" | "up" | "degraded" | "silent";
  in_use: boolean; // whether the service sends over this link
  loss_pct: number | null;
  silent_since_us: number | null;
}

export interface Vehicle {
  at_us: number;
  vehicle: string;
  kind: string;
  stack: string;
  system_id: number;
  home_lat_deg: number;
  home_lon_deg: number;
  link: "never heard" | "online" | "lost";
  links: Link[]; // the preferred link first
  mode: string;
  armed: boolean;
  current_seq: number | null;
  battery_pct: number | null;
  lost_link: string; // reaction to a lost link; empty if unknown
  return_height_m: number | null;
  fence_action: string;
  remote_id: string; // "ready", "fails: …", "lost: …"; empty before its first message
  time_on_task_s: number | null; // until it must fly home; negative after this time
  time_home_s: number | null; // of the flight home
  time_landing_s: number | null;
  must_land_at_us: number | null; // the reserve then remains
  energy_source: string;
  checks: Check[]; // pre-flight checks, on the ground
  waits_for_signoff: boolean; // whether the next takeoff needs a sign-off
  signed_off_by: string;
  position_good: boolean;
  position_fix: string;
  order: string; // the order in force: hold, return, land
  landing: string; // phase of a landing: waiting, sending, approach, final, going around
  relief: string; // in a task that vehicles fly in turn: on task, relieves hawk in 4 min, stands by
  direction: string;
  decisions: number;
  reversals: number;
  reversed_at_us: number | null;
  importance_back: number;
  importance_front: number;
  front_cells: number;
  orbit: Orbit | null;
  ordered_airspeed_m_s: number | null;
  wind_speed_m_s: number | null;
  wind_from_deg: number | null;
}

export const LOITER_UNLIMITED = 17; // a command of an item

export interface Item {
  command: number;
  name: string;
  frame: number;
  lat_deg: number | null;
  lon_deg: number | null;
  altitude_m: number;
  params: [number, number, number, number];
}

export interface Mission {
  mission_id: number;
  at_us: number;
  why: string;
  outcome: string; // proposed, sending, accepted, or an error
  reason: string;
  mission_hash: string;
  items: Item[];
}

export interface MissionState {
  at_us: number;
  vehicle: string;
  on_board: Mission | null;
  sending: Mission | null;
  proposed: Mission | null;
}

export interface Alarm {
  alarm: string;
  at_us: number;
  vehicle: string;
  severity: "warning" | "severe";
  text: string;
  cleared_at_us: number | null;
  acknowledged_by: string;
}

/** When the fire reaches a person or a value at risk; null: not within the forecast. */
export interface FireArrival {
  at_us: number;
  key: string;
  name: string;
  kind: "person" | "value";
  lat_deg: number;
  lon_deg: number;
  early_at_us: number | null; // with a probability of 10 %
  median_at_us: number | null; // 50 %
  late_at_us: number | null; // 90 %
}

export interface Announcement {
  id: number;
  at_us: number;
  vehicle: string;
  level: string;
  text: string;
}

/** A line of the log that is not announced. */
export interface LogRecord extends Announcement {
  kind: "fire" | "settings" | "note" | "mission" | "alarm";
  note: string; // text of a note about a place
  lat_deg: number | null;
  lon_deg: number | null;
  photo: string; // name of the photo of a note
}

export interface Fire {
  at_us: number;
  version: number; // increases with each correction by an operator
  area_ha: number;
  wind_speed_m_s: number | null;
  wind_from_deg: number | null;
  wind_set_by: string;
  corrections: Correction[];
}

/** The contribution and the state of a source of observations. */
export interface Source {
  at_us: number;
  source: string;
  kind: "camera" | "sensor" | "detector" | "person";
  state: "waiting" | "live" | "late" | "silent" | "contradicts" | "failed";
  problem: string; // why it is not live, or what the sensor reports
  observations: number;
  not_used: number;
  burned_cells: number;
  unburned_cells: number;
  last_at_us: number | null;
  age_s: number | null; // at the time of `at_us`
  usual_interval_s: number | null;
  position_sd_m: number | null;
}

/** Another aircraft, relative to the vehicle with the highest alert or the smallest distance. */
export interface Aircraft {
  at_us: number;
  aircraft: string; // ICAO address in hexadecimal digits, or another identifier
  callsign: string;
  lat_deg: number;
  lon_deg: number;
  altitude_amsl_m: number;
  ground_speed_m_s: number;
  track_deg: number;
  climb_m_s: number;
  age_s: number;
  source: string;
  alert: "none" | "preventive" | "corrective" | "warning";
  vehicle: string;
  distance_m: number;
  above_m: number; // negative: below the vehicle
}

/** Properties of an observation in GET /fire/observations. */
export interface Observation {
  number: number;
  source: string;
  at_us: number;
  position_sd_m: number;
  distrusted: boolean;
  state: string | null; // of a report: burned, burning, unburned, hot, smoke
  part: "seen" | "burned" | "reported";
}

/** An image of a sensor on the map, in GET /fire/images. The ellipse has semi-axes of one standard deviation. */
export interface MapImage {
  source: string;
  number: number;
  at_us: number;
  vehicle: string;
  name: string; // of the file or stream
  lat_deg: number; // of the ellipse
  lon_deg: number;
  position_sd_m: number;
  major_m: number;
  minor_m: number;
  major_from_deg: number;
  corners: [LonLat, LonLat, LonLat, LonLat]; // NW, NE, SE, SW
  scale: [number, string][]; // values and their colours
  unit: string; // of the values
}

export interface Correction {
  state: string;
  shape: string;
  points: [number, number][]; // lat, lon
  marked_at_s: number;
  at_s: number;
  by: string;
}

export interface Drop {
  at_us: number;
  vehicle: string;
  plan_hash: string;
  number: number;
  lat_deg: number;
  lon_deg: number;
  outcome: string; // ordered, done, refused, unknown
}

export interface PlanPoint {
  lat_deg: number;
  lon_deg: number;
  altitude_amsl_m: number;
  height_m: number;
  after_s: number;
}

export interface IgnitionPlan {
  vehicle: string;
  line: number;
  begin_us: number;
  valid_until_us: number;
  path: PlanPoint[];
  drops: { number: number; lat_deg: number; lon_deg: number; after_s: number }[];
  skipped: [number, number][];
  duration_s: number;
  speed_m_s: number;
  drop_height_m: number;
  safe_height_m: number;
  wind_speed_m_s: number;
  wind_from_deg: number;
  time_margin_s: number;
  distance_margin_m: number;
  min_time_margin_s: number;
  spheres_left: number;
}

export interface ListItem {
  item: string;
  answer: "go" | "no-go" | "open";
  by?: string;
  station?: string;
}

export type Ring = [number, number][]; // lat, lon; the last corner is the first

export interface CheckedPlan {
  plan_hash: string;
  approved: { by: string; station: string } | null;
  why_not: string | null;
}

export interface Burn {
  at_us: number;
  plans: CheckedPlan[]; // as the interlock has checked them
  open_items: string[];
  guidance: {
    phase: string;
    line: number;
    complete: boolean;
    approved_by: string | null;
    drops_planned: number;
    drops_done: number;
    spheres_left: number;
    checklist: { complete: boolean; open: number; items: ListItem[] };
    unit: Ring[];
    no_drop: Ring[];
    fence: Ring[];
    people: [string, number, number, number][]; // name, lat, lon, radius in metres
  };
  plan: IgnitionPlan | null;
  plan_hash: string;
  drops: Drop[];
  stations: { name: string; lat_deg: number; lon_deg: number }[];
}

export interface Status {
  at_us: number;
  time_unix_us: number;
  scenario: string;
  rule: string;
  duration_s: number;
  not_ready: string[];
  stopping: boolean;
  formation?: unknown;
}

/** The mission that would be sent to a vehicle now, and its difference from the one on board. */
export interface Preview {
  at_us: number;
  vehicle: string;
  mission_hash: string;
  items: Item[];
  figures: {
    items: number;
    length_m: number;
    min_height_agl_m: number | null;
    highest_amsl_m: number | null;
    farthest_from_home_m: number;
    outside_landscape: boolean;
    problems: string[];
  };
  difference: { alike_first: number; added: number; removed: number; farthest_moved_m: number };
}

/** Importances that the planner compares: cells (lat, lon, importance) from the vehicle backwards. */
export interface Importance {
  at_us: number;
  vehicle: string;
  rule: string;
  importance_back: number;
  importance_front: number;
  cells: [number, number, number][];
}

export interface Landscape {
  bounds: [number, number, number, number]; // west, south, east, north
  corners_lon_lat: LonLat[];
  cell_size_m: number;
  rows: number;
  cols: number;
}

export type Planner = Record<string, unknown>;

/** State of a replay. All times except `at_us` and `begin_us` are times of the log's clock. */
export interface Replay {
  at_us: number;
  logs: string[];
  log_begin_us: number;
  log_end_us: number;
  log_at_us: number;
  begin_us: number;
  speed: number | "max";
  paused: boolean;
  seeking: boolean;
  ended: boolean;
  jumps: number; // changes when the replay jumps to another time
}

/** A closed volume of airspace; a limit of null means the ground, or no upper limit. */
export interface Volume {
  name: string;
  geometry: GeoJSON.Geometry;
  floor_amsl_m: number | null;
  ceiling_amsl_m: number | null;
  from_us: number;
  until_us: number | null;
}

/** The progress of one vehicle while the airspace is cleared; times are mission times. */
export interface ClearedVehicle {
  vehicle: string;
  phase: "ordered" | "acknowledged" | "waiting" | "on its way" | "out" | "on the ground" | "not reached";
  why: string;
  out_by_us: number | null;
  expected_us: number | null;
}

/** The last request to clear the airspace; an empty volume means that all vehicles land. */
export interface Clearing {
  volume: string;
  by: string;
  ordered_at_us: number;
  outcome: "in force" | "complete" | "cancelled";
  ended_at_us: number | null;
  vehicles_out: number;
  last_expected_us: number | null;
  vehicles: ClearedVehicle[];
}

export interface Airspace {
  volumes: Volume[];
  max_altitude_agl_m: number | null;
  clearing: Clearing | null;
}

/** The response of /state: the complete state for a new page. */
export interface State {
  version: number;
  status: Status;
  roles: Role[];
  by: string;
  vehicles: Vehicle[];
  telemetry: Telemetry[];
  missions: MissionState[];
  fire: Fire;
  burn: Burn | null;
  alarms: Alarm[];
  announcements: Announcement[];
  records: LogRecord[];
  landscape: Landscape;
  rule: string;
  planner: Planner;
  replay: Replay | null; // null: a live run
  sources: Source[];
  airspace: Airspace;
  aircraft: Aircraft[];
  fire_arrivals: FireArrival[];
}
