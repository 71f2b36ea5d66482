// A dial to draw the wind: the arrow has the direction of the wind, its length is the speed.

import { h } from "./dom.ts";
import { t } from "./messages.ts";
import { colour } from "./preferences.ts";
import { speedUnit } from "./units.ts";

const SIZE = 180;
const MIDDLE = SIZE / 2;
const RIM = 78; // pixels at the maximum speed
const MAX_M_S = 20;
const STEPS = [5, 10]; // between two rings, in the chosen unit
const MAX_RINGS = 4;

export interface Wind {
  from_deg: number;
  speed_m_s: number;
}

/** The step between two rings, in the chosen unit. */
const ringStep = (): number => STEPS.find((step) => step * MAX_RINGS * speedUnit().si >= MAX_M_S) ?? STEPS.at(-1)!;

/** The wind of a drag from the middle to (x, y), y down; rounded to 5° and a tenth of the step between rings. */
function windOf(x: number, y: number): Wind {
  const deg = (Math.atan2(x, -y) * 180) / Math.PI;
  const share = Math.min(1, Math.hypot(x, y) / RIM);
  const tenthM_S = (ringStep() / 10) * speedUnit().si;
  return { from_deg: (Math.round(deg / 5) * 5 + 360) % 360, speed_m_s: Math.round((share * MAX_M_S) / tenthM_S) * tenthM_S };
}

/** The tail of a wind's arrow relative to the middle, y down. */
function tailOf(wind: Wind): [number, number] {
  const length = (Math.min(wind.speed_m_s, MAX_M_S) / MAX_M_S) * RIM;
  const angle = (wind.from_deg * Math.PI) / 180;
  return [Math.sin(angle) * length, -Math.cos(angle) * length];
}

/** A dial that calls `changed` while the arrow is drawn. `show` displays the current and a new wind. */
export function windDial(changed: (wind: Wind) => void): {
  element: HTMLCanvasElement;
  show: (now: Wind | null, entered: Wind | null) => void;
} {
  const canvas = h("canvas", {
    width: SIZE * 2,
    height: SIZE * 2,
    class: "dial",
    role: "img",
    "aria-label": t("Wind dial: drag from the middle to the direction from which the wind blows"),
  });
  const draw = (event: PointerEvent): void => {
    const box = canvas.getBoundingClientRect();
    const scale = SIZE / box.width;
    changed(windOf((event.clientX - box.left) * scale - MIDDLE, (event.clientY - box.top) * scale - MIDDLE));
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    draw(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.hasPointerCapture(event.pointerId)) draw(event);
  });
  return { element: canvas, show: (now, entered) => paint(canvas, now, entered) };
}

function paint(canvas: HTMLCanvasElement, now: Wind | null, entered: Wind | null): void {
  const pen = canvas.getContext("2d");
  if (!pen) return;
  pen.setTransform(2, 0, 0, 2, 0, 0);
  pen.clearRect(0, 0, SIZE, SIZE);
  pen.translate(MIDDLE, MIDDLE);
  pen.strokeStyle = colour("--edge");
  pen.fillStyle = colour("--ink");
  pen.lineWidth = 1;
  pen.font = "11px sans-serif";
  const { si } = speedUnit();
  for (let ring = 1; ring * ringStep() * si <= MAX_M_S; ring++) {
    const speed = ring * ringStep();
    const radius = ((speed * si) / MAX_M_S) * RIM;
    pen.beginPath();
    pen.arc(0, 0, radius, 0, 2 * Math.PI);
    pen.stroke();
    if (ring % 2 === 0) pen.fillText(String(speed), radius * Math.SQRT1_2 - 4, radius * Math.SQRT1_2 - 4);
  }
  pen.font = "bold 13px sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  for (const [name, x, y] of [[t("N"), 0, -1], [t("E"), 1, 0], [t("S"), 0, 1], [t("W"), -1, 0]] as const) {
    pen.fillText(name, x * (RIM - 9), y * (RIM - 9));
  }
  if (now) arrow(pen, now, colour("--accent"), 3);
  if (entered) arrow(pen, entered, colour("--red"), 5);
}

/** Draw an arrow from the side from which the wind blows to the middle. */
function arrow(pen: CanvasRenderingContext2D, wind: Wind, fill: string, width: number): void {
  const [x, y] = tailOf(wind);
  const length = Math.hypot(x, y);
  pen.strokeStyle = pen.fillStyle = fill;
  pen.lineWidth = width;
  pen.beginPath();
  pen.arc(x, y, width + 3, 0, 2 * Math.PI);
  pen.fill();
  if (length < 4) return;
  const [ux, uy] = [x / length, y / length];
  pen.beginPath();
  pen.moveTo(x, y);
  pen.lineTo(ux * 12, uy * 12);
  pen.stroke();
  pen.beginPath();
  pen.moveTo(0, 0);
  pen.lineTo(ux * 16 - uy * 8, uy * 16 + ux * 8);
  pen.lineTo(ux * 16 + uy * 8, uy * 16 - ux * 8);
  pen.fill();
}
