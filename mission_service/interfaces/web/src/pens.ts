// Pens that draw corrections of the fire, and closed airspace, on a canvas over the map. One finger, stylus or mouse draws;
// two fingers and the wheel move the map. After the first use of a stylus, a single finger (or the
// palm) moves the map too. With the keyboard, Space adds a corner at the centre of the map and Enter
// ends the stroke.

import { LngLat, type Map as MapView } from "maplibre-gl";
import { h } from "./dom.ts";
import { simplified, uncrossed } from "./geo.ts";
import { t } from "./messages.ts";
import { PALETTE } from "./palette.ts";

export type State = "burned" | "burning" | "unburned";
export type Pen = State | "closed" | "measure" | "note"; // closed: airspace; measure: the length of a line
export type Shape = "point" | "line" | "polygon";
export type Tool = { pen: Pen; shape: Shape } | { eraser: true; radiusPx: number } | null;

export interface Stroke {
  tool: Exclude<Tool, null>;
  points: [number, number][]; // lat, lon
  radiusM: number; // of the eraser
}

export const COLOURS: Record<Pen, string> = PALETTE.pens;
const TOLERANCE_PX = 1.5;
const MAX_POINTS = 900;
const ERASER_COLOUR = "#444444";

type Dot = [number, number]; // pixels of the canvas

export class Pens {
  tool: Tool = null;
  readonly element: HTMLCanvasElement;
  private dots: Dot[] = [];
  private drawing: number | null = null; // the pointer that draws
  private touches = new Map<number, Dot>();
  private penSeen = false;
  private corners: [number, number][] = []; // entered with the keyboard: lat, lon

  constructor(
    private readonly map: MapView,
    private readonly onStroke: (stroke: Stroke) => void,
    private readonly announce: (text: string) => void,
  ) {
    this.element = h("canvas", { class: "sheet", "aria-hidden": "true" });
    map.getContainer().append(this.element);
    new ResizeObserver(() => this.fit()).observe(map.getContainer());
    const on = <K extends keyof HTMLElementEventMap>(
      kind: K,
      act: (event: HTMLElementEventMap[K]) => void,
    ): void => this.element.addEventListener(kind, act, { passive: false });
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.up(event, true));
    on("pointercancel", (event) => this.up(event, false));
    on("wheel", (event) => this.wheel(event));
    map.on("move", () => this.paint());
    map.getContainer().addEventListener("keydown", (event) => this.key(event), { capture: true });
  }

  use(tool: Tool): void {
    this.tool = tool;
    this.clear();
    this.element.classList.toggle("active", tool !== null);
  }

  private clear(): void {
    this.dots = [];
    this.corners = [];
    this.drawing = null;
    this.paint();
  }

  // Pointer input --------------------------------------------------------------------------------

  private at(event: PointerEvent | WheelEvent): Dot {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  private down(event: PointerEvent): void {
    event.preventDefault();
    this.element.setPointerCapture(event.pointerId);
    this.map.getCanvas().focus({ preventScroll: true });
    if (event.pointerType === "pen") this.penSeen = true;
    if (event.pointerType === "touch") this.touches.set(event.pointerId, this.at(event));
    const draws = event.pointerType === "touch" ? !this.penSeen && this.touches.size === 1 : event.button === 0;
    if (draws) {
      this.drawing = event.pointerId;
      this.dots = [this.at(event)];
    } else if (this.touches.size > 1 && this.drawing !== null && this.touches.has(this.drawing)) {
      this.clear(); // a second finger moves the map
    }
    this.paint();
  }

  private move(event: PointerEvent): void {
    if (this.drawing === event.pointerId) {
      const events = event.getCoalescedEvents();
      for (const each of events.length ? events : [event]) this.dots.push(this.at(each));
      if (this.tool && "shape" in this.tool && this.tool.shape === "point") {
        this.dots = this.dots.slice(-1);
      }
      this.paint();
    } else if (this.touches.has(event.pointerId)) {
      this.moveMap(event.pointerId, this.at(event));
    }
  }

  private up(event: PointerEvent, complete: boolean): void {
    this.touches.delete(event.pointerId);
    if (this.drawing !== event.pointerId) return;
    const dots = this.dots;
    this.clear();
    if (complete) this.end(dots);
  }

  private moveMap(pointer: number, to: Dot): void {
    const before = [...this.touches.values()];
    this.touches.set(pointer, to);
    const after = [...this.touches.values()];
    const middle = (dots: Dot[]): Dot => [
      dots.reduce((sum, [x]) => sum + x, 0) / dots.length,
      dots.reduce((sum, [, y]) => sum + y, 0) / dots.length,
    ];
    const [a, b] = [middle(before), middle(after)];
    this.map.panBy([a[0] - b[0], a[1] - b[1]], { duration: 0 });
    if (after.length < 2) return;
    const spread = (dots: Dot[]): number =>
      Math.hypot(dots[0]![0] - dots[1]![0], dots[0]![1] - dots[1]![1]) || 1;
    const zoom = this.map.getZoom() + Math.log2(spread(after) / spread(before));
    this.map.zoomTo(zoom, { duration: 0, around: this.map.unproject(b) });
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    const step = -event.deltaY / (event.deltaMode === 0 ? 400 : 12);
    const around = this.map.unproject(this.at(event));
    this.map.zoomTo(this.map.getZoom() + step, { duration: 0, around });
  }

  private latLon([x, y]: Dot): [number, number] {
    const { lat, lng } = this.map.unproject([x, y]);
    return [lat, lng];
  }

  private drawn(stroke: Stroke): void {
    this.onStroke({ ...stroke, points: stroke.points.map(placeOf) });
  }

  private end(dots: Dot[]): void {
    const tool = this.tool;
    if (!tool || !dots.length) return;
    if ("eraser" in tool) {
      const middle = dots.at(-1)!;
      this.drawn({ tool, points: [this.latLon(middle)], radiusM: this.metresAt(middle, tool.radiusPx) });
      return;
    }
    if (tool.shape === "point") {
      this.drawn({ tool, points: [this.latLon(dots.at(-1)!)], radiusM: 0 });
      return;
    }
    let kept = simplified(dots, TOLERANCE_PX);
    for (let px = 2 * TOLERANCE_PX; kept.length > MAX_POINTS; px *= 2) kept = simplified(dots, px);
    if (tool.shape === "polygon") kept = uncrossed(kept);
    this.finish(kept.map((dot) => this.latLon(dot)));
  }

  private metresAt([x, y]: Dot, px: number): number {
    const a = this.map.unproject([x, y]);
    return a.distanceTo(this.map.unproject([x + px, y]));
  }

  private finish(points: [number, number][]): void {
    const tool = this.tool;
    if (!tool || "eraser" in tool) return;
    const least = tool.shape === "polygon" ? 3 : tool.shape === "line" ? 2 : 1;
    if (points.length < least) {
      this.announce(tool.shape === "polygon" ? t("Stroke too short for an area") : t("Stroke too short for a line"));
      return;
    }
    this.drawn({ tool, points, radiusM: 0 });
  }

  // Keyboard input -------------------------------------------------------------------------------

  private key(event: KeyboardEvent): void {
    if (!this.tool || event.target !== this.map.getCanvas()) return;
    if (event.key === " ") {
      const { lat, lng } = this.map.getCenter();
      const box = this.map.getContainer();
      if ("eraser" in this.tool) this.end([[box.clientWidth / 2, box.clientHeight / 2]]);
      else if (this.tool.shape === "point") this.finish([[lat, lng]]);
      else {
        this.corners.push([lat, lng]);
        this.announce(t("Corner {number}; Enter ends the stroke", { number: this.corners.length }));
      }
    } else if (event.key === "Enter" && this.corners.length) {
      const corners = this.corners;
      this.corners = [];
      this.finish("shape" in this.tool && this.tool.shape === "polygon" ? uncrossed(corners) : corners);
    } else if (event.key === "Escape" && (this.dots.length || this.corners.length)) {
      this.clear();
    } else {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
    this.paint();
  }

  // Drawing --------------------------------------------------------------------------------------

  private fit(): void {
    const box = this.map.getContainer();
    this.element.width = box.clientWidth * devicePixelRatio;
    this.element.height = box.clientHeight * devicePixelRatio;
    this.paint();
  }

  private paint(): void {
    const ink = this.element.getContext("2d");
    if (!ink) return;
    ink.setTransform(1, 0, 0, 1, 0, 0);
    ink.clearRect(0, 0, this.element.width, this.element.height);
    if (!this.tool) return;
    ink.scale(devicePixelRatio, devicePixelRatio);
    const colour = "pen" in this.tool ? COLOURS[this.tool.pen] : ERASER_COLOUR;
    const projected = this.corners.map(([lat, lng]): Dot => {
      const { x, y } = this.map.project([lng, lat]);
      return [x, y];
    });
    this.stroke(ink, this.dots.length ? this.dots : projected, colour);
    this.middle(ink, colour);
  }

  private stroke(ink: CanvasRenderingContext2D, dots: Dot[], colour: string): void {
    const tool = this.tool;
    const last = dots.at(-1);
    if (!tool || !last) return;
    ink.strokeStyle = ink.fillStyle = colour;
    ink.lineWidth = 5;
    ink.lineJoin = ink.lineCap = "round";
    ink.beginPath();
    if ("eraser" in tool) {
      ink.arc(last[0], last[1], tool.radiusPx, 0, 2 * Math.PI);
      ink.stroke();
      return;
    }
    if (tool.shape === "point" || dots.length === 1) {
      ink.arc(last[0], last[1], 8, 0, 2 * Math.PI);
      ink.fill();
      return;
    }
    ink.moveTo(...dots[0]!);
    for (const dot of dots) ink.lineTo(...dot);
    if (tool.shape === "polygon") {
      ink.closePath();
      ink.globalAlpha = 0.25;
      ink.fill();
      ink.globalAlpha = 1;
    }
    ink.stroke();
  }

  /** Draw a cross at the centre for keyboard input, while the map has the focus. */
  private middle(ink: CanvasRenderingContext2D, colour: string): void {
    if (!this.map.getContainer().contains(document.activeElement)) return;
    const box = this.map.getContainer();
    const [x, y] = [box.clientWidth / 2, box.clientHeight / 2];
    ink.lineWidth = 2;
    ink.strokeStyle = colour;
    ink.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
      ink.moveTo(x + 5 * dx, y + 5 * dy);
      ink.lineTo(x + 16 * dx, y + 16 * dy);
    }
    ink.stroke();
  }
}

/** A place on the map as the service expects it: longitudes within 180°, to a centimetre. */
function placeOf([lat, lon]: [number, number]): [number, number] {
  return [Number(lat.toFixed(7)), Number(new LngLat(lon, lat).wrap().lng.toFixed(7))];
}
