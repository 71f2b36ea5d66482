// The form for a new incident: it sends files and values to the service, which makes the scenario file.

import "./base.css";
import "./incident.css";
import { byId, fill, h } from "./dom.ts";
import { draw } from "./incident_sketch.ts";
import { t, translateDocument } from "./messages.ts";
import "./preferences.ts"; // the colours of the page
import { takeToken, token } from "./token.ts";

type Field = HTMLInputElement | HTMLSelectElement;

const LAYERS = ["fuel", "elevation", "slope", "aspect", "canopy_cover", "canopy_height", "canopy_base_height", "canopy_bulk_density"];
const MOISTURES: [string, string][] = [
  [t("1 h, %"), "6"], [t("10 h, %"), "7"], [t("100 h, %"), "8"], [t("Herbs, %"), "60"], [t("Wood, %"), "90"],
];

translateDocument();
document.title = t("New incident");
takeToken();

// Fields ---------------------------------------------------------------------------------------------------------------

/** A required field with a label; `wide` is for long values. */
function labelled(label: string, field: Field, wide = false): HTMLElement {
  field.required = true;
  return h("label", { class: wide ? "wide" : "" }, label, field);
}

/** An optional field with a label. */
function optional(label: string, field: Field, wide = false): HTMLElement {
  const element = labelled(label, field, wide);
  field.required = false;
  return element;
}

const number = (value = "", step = "any"): HTMLInputElement => h("input", { type: "number", step, value });
const words = (value = "", example = ""): HTMLInputElement => h("input", { type: "text", value, placeholder: example });
const file = (accept: string): HTMLInputElement => h("input", { type: "file", accept });
const check = (label: string, box: HTMLInputElement): HTMLElement => h("label", { class: "check" }, box, label);
const box = (): HTMLInputElement => h("input", { type: "checkbox" });
const select = (choices: [string, string][]): HTMLSelectElement =>
  h("select", {}, ...choices.map(([value, label]) => h("option", { value }, label)));

/** Rows of fields that the user adds and removes; at least one row remains. */
class Rows<Row extends { element: HTMLElement }> {
  readonly element = h("div");
  rows: Row[] = [];

  constructor(private readonly make: () => Row, add: string) {
    const button = h("button", { type: "button", onclick: () => this.add() }, add);
    this.element.append(h("div", { class: "choices" }, button));
    this.add();
  }

  private add(): void {
    const row = this.make();
    const remove = h("button", { type: "button", "aria-label": t("Remove"), onclick: () => this.remove(row) }, "×");
    row.element.append(remove);
    this.rows.push(row);
    this.element.lastElementChild!.before(row.element);
    this.offerRemoval();
  }

  private remove(row: Row): void {
    this.rows = this.rows.filter((each) => each !== row);
    row.element.remove();
    this.offerRemoval();
  }

  private offerRemoval(): void {
    for (const { element } of this.rows) element.lastElementChild!.toggleAttribute("hidden", this.rows.length === 1);
  }
}

/** A choice between groups of fields, of which one is shown. */
class Choice {
  readonly element = h("div");
  private chosen = 0;

  constructor(private readonly groups: { label: string; content: HTMLElement }[]) {
    const buttons = groups.map(({ label }, index) =>
      h("button", { type: "button", onclick: () => this.choose(index) }, label));
    this.element.append(h("div", { class: "choices" }, ...buttons), ...groups.map(({ content }) => content));
    this.choose(0);
  }

  private choose(chosen: number): void {
    this.chosen = chosen;
    this.groups.forEach(({ content }, index) => content.toggleAttribute("hidden", index !== chosen));
    const buttons = this.element.firstElementChild!.children;
    [...buttons].forEach((each, index) => each.setAttribute("aria-pressed", String(index === chosen)));
  }

  is(index: number): boolean {
    return this.chosen === index;
  }
}

const group = (...fields: HTMLElement[]): HTMLElement => h("div", { class: "fields" }, ...fields);
const hint = (text: string): HTMLElement => h("p", { class: "hint" }, text);

// The ground
const edges = { west: number(), south: number(), east: number(), north: number() };
const fuelModel = number("2", "1");
const landscape = file(".lcp,.tif,.tiff");
const chosenLayers = (): string[] =>
  [...document.querySelectorAll<HTMLSelectElement>("select[data-layer]")].map((each) => each.value);
const layers = new Rows(() => {
  const name = select(LAYERS.map((each) => [each, each]));
  name.dataset.layer = "yes";
  name.value = LAYERS.find((each) => !chosenLayers().includes(each)) ?? LAYERS[0]!;
  const raster = file(".tif,.tiff,.asc");
  const unit = select([["", t("as stated in the file")], ["percent", "percent"], ["degrees", "degrees"], ["metres", "metres"], ["feet", "feet"]]);
  return { name, raster, unit, element: group(labelled(t("Layer"), name), labelled(t("File"), raster, true), optional(t("Unit"), unit)) };
}, t("Add a raster"));
const gaps = box();
const ground = new Choice([
  {
    label: t("Level ground"),
    content: h("div", {},
      group(
        labelled(t("West, °"), edges.west), labelled(t("South, °"), edges.south),
        labelled(t("East, °"), edges.east), labelled(t("North, °"), edges.north),
        labelled(t("Fuel model"), fuelModel),
      ),
      hint(t("Degrees with decimals, negative to the west and south: -84.15, 36.35.")),
    ),
  },
  { label: t("One landscape file"), content: group(labelled(t("Landscape (.lcp or GeoTIFF)"), landscape, true)) },
  { label: t("Rasters"), content: layers.element },
]);
const noData = group(check(t("Cells without data are unburnable"), gaps)); // of files

// The weather
const windSpeed = number();
const windFrom = number();
const weather = file(".raws,.wxs,.wtr,.csv");
const start = h("input", { type: "datetime-local" });
const wind = new Choice([
  { label: t("Constant wind"), content: group(labelled(t("Wind speed, m/s"), windSpeed), labelled(t("Blows from, °"), windFrom)) },
  {
    label: t("Weather file"),
    content: group(labelled(t("Weather (.raws, .wxs, .wtr, .csv)"), weather, true), optional(t("Mission time 0, local time"), start, true)),
  },
]);
const moistures = MOISTURES.map(([label, value]) => ({ label, field: number(value) }));

// The fire
const ignitions = new Rows(() => {
  const [lat, lon] = [number(), number()];
  return { lat, lon, element: group(labelled(t("Latitude, °"), lat), labelled(t("Longitude, °"), lon)) };
}, t("Add an ignition"));
const perimeter = file(".geojson,.json,.kml,.kmz,.gpkg,.zip");
const fire = new Choice([
  { label: t("Ignitions"), content: ignitions.element },
  { label: t("Perimeter"), content: group(labelled(t("Perimeter (GeoJSON, KML, GeoPackage, zipped Shapefile)"), perimeter, true)) },
]);
const real = box();

// The aircraft
const aircraft = new Rows(() => {
  const name = words("", "hawk");
  const stack = select([["px4", "PX4"], ["ardupilot", "ArduPilot"]]);
  const kind = select([["plane", t("plane")], ["vtol", "VTOL"], ["copter", t("copter")]]);
  const [lat, lon] = [number(), number()];
  const link = words("", "udpin:127.0.0.1:14550");
  const systemId = number("", "1");
  const element = h("div", { class: "fields" },
    labelled(t("Name"), name), labelled(t("Autopilot"), stack), labelled(t("Kind"), kind),
    labelled(t("Latitude of the home, °"), lat), labelled(t("Longitude of the home, °"), lon),
    optional(t("MAVLink connection"), link, true), optional(t("System id"), systemId),
  );
  return { name, stack, kind, lat, lon, link, systemId, element };
}, t("Add an aircraft"));

const hours = number("6");
const zero = h("input", { type: "datetime-local", onchange: () => {
  if (!offset.dataset.edited) offset.value = offsetAt(new Date(zero.value || Date.now()));
} });
const offset = words(offsetAt(new Date()));
offset.addEventListener("input", () => (offset.dataset.edited = "yes"));

/** The UTC offset of this browser's time zone at a time: "-05:00". */
function offsetAt(time: Date): string {
  const minutes = -time.getTimezoneOffset();
  const part = (value: number): string => String(Math.floor(value)).padStart(2, "0");
  return `${minutes < 0 ? "-" : "+"}${part(Math.abs(minutes) / 60)}:${part(Math.abs(minutes) % 60)}`;
}

// The page -------------------------------------------------------------------------------------------------------------

const part = (title: string, ...children: (Node | null)[]): HTMLElement => h("fieldset", {}, h("legend", {}, title), ...children);
const save = h("button", { type: "submit", class: "primary save" }, t("Check and save"));
const result = h("div", { id: "result", role: "status", "aria-live": "polite" });
const form = h("form", { novalidate: true, onsubmit: submit, oninput: sketch, onclick: () => setTimeout(sketch) },
  part(t("Ground"), ground.element, noData),
  part(
    t("Weather"), wind.element, hint(t("Moistures of dead fuels by size, and of live fuels:")),
    group(...moistures.map(({ label, field }) => labelled(label, field))),
  ),
  part(t("Fire"), fire.element, group(check(t("A real fire (otherwise, cameras observe a simulated one)"), real))),
  part(t("Aircraft"), aircraft.element),
  part(t("Time"), group(
    labelled(t("Duration, h"), hours),
    optional(t("Calendar time of mission time 0 (for products)"), zero, true), optional(t("UTC offset"), offset),
  )),
  save,
);
fill(byId("incident"), h("h1", {}, t("New incident")), h("p", {}, t("The scenario is checked and saved on this computer.")), form, result);
const drawing = document.createElementNS("http://www.w3.org/2000/svg", "svg");
drawing.id = "sketch";
drawing.setAttribute("role", "img");
drawing.setAttribute("aria-label", t("Sketch of the positions: area, ignitions, homes"));
form.querySelectorAll("fieldset")[3]!.append(drawing);
sketch();

/** The numbers of fields; null if one of them is empty. */
function numbers(...fields: Field[]): number[] | null {
  const found = fields.map((field) => Number.parseFloat(field.value));
  return found.every(Number.isFinite) ? found : null;
}

/** The first field that is shown and must be completed or corrected. */
const incomplete = (): Field | undefined =>
  [...form.querySelectorAll<Field>("input, select")].find((field) =>
    field.offsetParent !== null && (field.validity.badInput || (field.required && !field.value.trim())));

function sketch(): void {
  noData.toggleAttribute("hidden", ground.is(0));
  const { west, south, east, north } = edges;
  draw(drawing, {
    area: ground.is(0) ? (numbers(west, south, east, north) as [number, number, number, number] | null) : null,
    ignitions: fire.is(0) ? ignitions.rows.map(({ lat, lon }) => numbers(lat, lon) as [number, number] | null).filter((each) => each !== null) : [],
    homes: aircraft.rows
      .map(({ name, lat, lon }) => ({ name: name.value, place: numbers(lat, lon) as [number, number] }))
      .filter(({ place }) => place !== null),
  });
}

// Sending --------------------------------------------------------------------------------------------------------------

const joined = (...fields: Field[]): string => {
  const values = fields.map((field) => field.value.trim());
  while (values.at(-1) === "") values.pop();
  return values.join(",");
};

/** The request's reply. Throws Error with the reason of a refusal. */
async function send(path: string, method: string, body: BodyInit): Promise<Record<string, unknown>> {
  const headers = { Authorization: `Bearer ${token()}` };
  const response = await fetch(new URL(path, document.baseURI), { method, body, headers });
  const reply = (await response.json()) as Record<string, unknown>;
  if (!response.ok) throw new Error(String(reply.error));
  return reply;
}

/** Send the file of a field; return its name for the service ("" without a file), which may begin with `stem`. */
async function sent(field: HTMLInputElement, stem = ""): Promise<string> {
  const chosen = field.files?.[0];
  if (!chosen) return "";
  show("", t("Sending {name} …", { name: chosen.name }));
  const plain = chosen.name.replace(/[^A-Za-z0-9._-]/g, "_").slice(-60).replace(/^[.-]+/, "_");
  const name = stem ? `${stem}_${plain}` : plain;
  try {
    await chosen.slice(0, 1).arrayBuffer();
  } catch {
    throw new Error(t("{name} has changed since it was chosen: choose it again", { name: chosen.name }));
  }
  await send(`files/${encodeURIComponent(name)}`, "PUT", chosen);
  return name;
}

async function completed(): Promise<object> {
  const isFile = ground.is(1);
  const rasters = [];
  for (const { name, raster, unit } of ground.is(2) ? layers.rows : []) {
    const found = await sent(raster, name.value);
    if (found) rasters.push({ name: name.value, file: found, unit: unit.value });
  }
  return {
    box: ground.is(0) ? joined(edges.west, edges.south, edges.east, edges.north) : "",
    fuel_model: ground.is(0) ? fuelModel.value : "",
    landscape: isFile ? await sent(landscape) : "",
    layers: rasters,
    missing: gaps.checked && !ground.is(0) ? "unburnable" : "",
    wind: wind.is(0) ? joined(windSpeed, windFrom) : "",
    weather: wind.is(1) ? await sent(weather) : "",
    start: wind.is(1) ? withSeconds(start.value) : "",
    moistures: joined(...moistures.map(({ field }) => field)),
    ignitions: fire.is(0) ? ignitions.rows.map(({ lat, lon }) => joined(lat, lon)).filter(Boolean) : [],
    perimeter: fire.is(1) ? await sent(perimeter) : "",
    aircraft: aircraft.rows.filter(({ name }) => name.value.trim())
      .map(({ name, stack, kind, lat, lon, link, systemId }) => {
        if (systemId.value.trim() && !link.value.trim()) link.value = link.placeholder;
        return joined(name, stack, kind, lat, lon, link, systemId);
      }),
    time_zero: zero.value ? withSeconds(zero.value) + offset.value.trim() : "",
    hours: hours.value,
    real: real.checked,
  };
}

/** A time in the form of the command line: "2026-07-01T12:00:00". */
const withSeconds = (value: string): string => (value.length === 16 ? `${value}:00` : value);

function show(kind: string, ...children: (Node | string)[]): void {
  result.className = kind;
  fill(result, ...children);
}

async function submit(event: Event): Promise<void> {
  event.preventDefault();
  const field = incomplete();
  if (field) {
    show("refused", t("Complete the field: {label}", { label: field.labels?.[0]?.firstChild?.textContent ?? "" }));
    field.focus();
    return;
  }
  save.disabled = true;
  try {
    const fields = await completed();
    show("", t("Checking …"));
    const reply = await send("incident", "POST", JSON.stringify(fields));
    const warnings = (reply.warnings as string[]).map((each) => h("p", {}, t("Warning: {text}", { text: each })));
    show("saved", h("p", {}, h("strong", {}, t("Saved."))), ...warnings, t("Next, in a terminal:"), h("code", {}, String(reply.next)));
  } catch (error) {
    const lost = error instanceof TypeError ? t("The service does not answer: is the command still running?") : "";
    show("refused", lost || String((error as Error).message));
    save.disabled = false;
  }
}
