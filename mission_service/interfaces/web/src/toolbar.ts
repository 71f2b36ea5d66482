// The toolbar: what a pen draws (a state of the fire, or closed airspace), shape and time of the
// stroke; eraser, undo, redo.

import { attempt, lacking, showMessage } from "./actions.ts";
import { post } from "./api.ts";
import { closeHelp, confirmed, entered } from "./dialogs.ts";
import { byId, h, setReason, setText } from "./dom.ts";
import { acceptsChange, type Preview } from "./fire_preview.ts";
import { shortcut } from "./keys.ts";
import { t, word } from "./messages.ts";
import type { Pen, Pens, Shape, Stroke, Tool } from "./pens.ts";
import { sentPhoto } from "./photos.ts";
import type { Store } from "./store.ts";
import type { Role } from "./types.ts";
import { moment } from "./units.ts";

const PENS: [Pen, string, string][] = [
  ["burned", t("Burned"), "b"],
  ["burning", t("Burning"), "f"],
  ["unburned", t("Unburned"), "u"],
  ["closed", t("Closed"), "x"],
  ["measure", t("Measure"), "l"],
  ["note", t("Note"), "t"],
];
const TITLES: Partial<Record<Pen, string>> = { closed: t("Closed airspace"), measure: t("Measure a line"), note: t("Add a note") };
const SHAPE_OF: Partial<Record<Pen, Shape>> = { closed: "polygon", measure: "line", note: "point" }; // of all others the chosen one
const SHAPES: [Shape, string, string][] = [["point", t("Point"), "1"], ["line", t("Line"), "2"], ["polygon", t("Area"), "3"]];
const ERASER_PX = 22;

export class Toolbar {
  private shape: Shape = "line";
  private pen: Pen | "eraser" | null = null;
  private buttons = new Map<string, HTMLButtonElement>();
  private atSlider = h("input", { type: "checkbox", id: "for-slider" });
  private when = h("span", {}, t("now"));

  constructor(private readonly store: Store, private readonly pens: () => Pens | null) {
    const one = (key: string, label: string, title: string, act: () => void): HTMLButtonElement => {
      const button = h("button", { type: "button", title, class: `pen ${key}`, onclick: act }, label);
      this.buttons.set(key, button);
      return button;
    };
    byId("tools").append(
      one("move", t("Move"), t("Move the map (V)"), () => this.selectPen(null)),
      ...PENS.map(([state, label, key]) =>
        one(state, label, t("{pen} here ({key})", { pen: TITLES[state] ?? label, key: key.toUpperCase() }), () => this.selectPen(state)),
      ),
      h("hr"),
      ...SHAPES.map(([shape, label, key]) => one(shape, label, `${label} (${key})`, () => this.selectShape(shape))),
      h("hr"),
      one("eraser", t("Erase"), t("Erase corrections (E)"), () => this.selectPen("eraser")),
      one("undo", t("Undo"), t("Undo the last correction (Ctrl+Z)"), () => this.back("undo")),
      one("redo", t("Redo"), t("Redo the last undone correction (Ctrl+Y)"), () => this.back("redo")),
      h("label", { class: "when", for: "for-slider", title: t("Draw for the time of the slider instead of now") },
        this.atSlider, this.when),
    );
    shortcut("v", t("Move the map"), () => this.selectPen(null));
    for (const [state, label, key] of PENS) {
      shortcut(key, t("{pen}; Space adds a corner, Enter ends the stroke", { pen: TITLES[state] ?? t("Pen: {label}", { label: label.toLowerCase() }) }), () => this.selectPen(state));
    }
    for (const [shape, label, key] of SHAPES) {
      shortcut(key, t("Shape of the pen: {label}", { label: label.toLowerCase() }), () => this.selectShape(shape));
    }
    shortcut("e", t("Eraser"), () => this.selectPen("eraser"));
    shortcut("Ctrl+Z", t("Undo the last correction"), () => this.back("undo"));
    shortcut("Ctrl+Y", t("Redo"), () => this.back("redo"));
    shortcut("Ctrl+Shift+Z", t("Redo"), () => this.back("redo"));
    shortcut("Escape", t("Close a list or settings, or deselect the pen"), () => {
      if (!closeHelp()) this.selectPen(null);
    });
    this.atSlider.addEventListener("change", () => this.renew());
    store.on(["status", "moment"], () => this.renew());
    this.renew();
  }

  private selectPen(pen: Pen | "eraser" | null): void {
    const reason = pen && pen !== "measure" ? lacking(this.store, roleOf(pen)) : "";
    if (reason) return showMessage(reason, true);
    this.pen = pen;
    this.applyTool();
    if (pen) document.querySelector<HTMLElement>("#map canvas.maplibregl-canvas")?.focus({ preventScroll: true });
  }

  private selectShape(shape: Shape): void {
    this.shape = shape;
    this.applyTool();
  }

  private applyTool(): void {
    const tool: Tool =
      this.pen === null
        ? null
        : this.pen === "eraser"
          ? { eraser: true, radiusPx: ERASER_PX }
          : { pen: this.pen, shape: SHAPE_OF[this.pen] ?? this.shape };
    this.pens()?.use(tool);
    if (this.pen !== "measure") this.store.showMeasured([]);
    this.renew();
  }

  private renew(): void {
    const pressed = new Set<string>([this.pen ?? "move", this.pen && this.pen !== "eraser" ? (SHAPE_OF[this.pen] ?? this.shape) : this.shape]);
    const reason = lacking(this.store, "correct");
    for (const [key, button] of this.buttons) {
      if (key !== "undo" && key !== "redo") button.setAttribute("aria-pressed", String(pressed.has(key)));
      if (key !== "move" && key !== "measure") setReason(button, lacking(this.store, roleOf(key)));
    }
    setReason(this.atSlider, reason || (this.store.inMin === 0 ? t("The slider shows the present time") : ""));
    setText(this.when, t("for {moment}", { moment: moment(this.inMin) }));
  }

  /** The time to which a stroke applies, in minutes from now. */
  private get inMin(): number {
    return this.atSlider.checked ? this.store.inMin : 0;
  }

  private back(which: "undo" | "redo"): void {
    const reason = lacking(this.store, "correct");
    if (reason) return showMessage(reason, true);
    void attempt(which === "undo" ? t("Undo") : t("Redo"), () => post(`fire/${which}`));
  }

  /** Send a stroke as a correction or an erasure. */
  async send({ tool, points, radiusM }: Stroke): Promise<boolean> {
    if ("eraser" in tool) {
      const [lat_deg, lon_deg] = points[0]!;
      return this.correct(t("Erase"), "erase", "fire/erase", { lat_deg, lon_deg, radius_m: Math.round(radiusM) });
    }
    if (tool.pen === "measure") {
      this.store.showMeasured(points);
      return true;
    }
    if (tool.pen === "note") return this.addNote(points[0]!);
    if (tool.pen === "closed") return this.closeAirspace(points);
    const body = { state: tool.pen, shape: tool.shape, points, in_s: this.inMin * 60 };
    return this.correct(t("Correction ({pen}, {moment})", { pen: word(tool.pen), moment: moment(this.inMin) }), "correct", "fire/corrections", body);
  }

  /** Send a correction, after a confirmation if it changes much of the fire; the message offers to undo it. */
  private correct(action: string, request: string, path: string, body: object): Promise<boolean> {
    return attempt(action, async () => {
      const preview = (): Promise<Preview> => post<Preview>("fire/preview", { do: request, ...body });
      if (!(await acceptsChange(this.store, preview))) return { messages: [t("not applied")] };
      return { ...await post(path, body), undo: () => this.back("undo") };
    });
  }

  /** Ask for the text and the photo of a note about a place, and add the note. */
  private async addNote([lat_deg, lon_deg]: [number, number]): Promise<boolean> {
    const note = await entered(t("Note about this place, for all users of the map and for the log"));
    if (!note) return false;
    return attempt(t("Note"), async () => {
      const photo = note.photo ? await sentPhoto(note.photo) : "";
      return post("notes", { text: note.text, lat_deg, lon_deg, photo });
    });
  }

  /** Close the airspace over an area after a confirmation. */
  private async closeAirspace(corners: [number, number][]): Promise<boolean> {
    const names = new Set(this.store.state?.airspace.volumes.map(({ name }) => name));
    let number = 1;
    while (names.has(`area ${number}`)) number += 1;
    const question = t("Close this airspace to all vehicles, at all altitudes, until it is opened? Vehicles inside leave it; no vehicle takes off until they are out.");
    if (!(await confirmed(question))) return false;
    const name = `area ${number}`;
    const clearing = this.store.state?.airspace.clearing;
    if (clearing?.outcome === "in force" && !clearing.volume) { // all vehicles land already
      return attempt(t("Close airspace"), () => post("airspace/close", { name, corners }));
    }
    return attempt(t("Close airspace"), () => post("airspace/clear", { volume: name, corners }));
  }
}

const roleOf = (key: string): Role => (key === "closed" ? "fly" : "correct");
