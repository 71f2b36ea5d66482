// The next decision as a strip: the vehicle in the middle, the front behind it to the left, the front
// ahead to the right, with a bar for the importance of each cell; below, both sums.

import { h } from "./dom.ts";
import { significant, t } from "./messages.ts";
import { colour } from "./preferences.ts";
import type { Importance } from "./types.ts";

const [WIDTH, HEIGHT] = [356, 130];
const NAME = t("Importance of the front behind and ahead");
const [BARS_TOP, BARS_BASE] = [22, 82];

export function makeStrip(): {
  element: HTMLCanvasElement;
  show: (importance: Importance | null, otherwise?: string) => void;
} {
  const canvas = h("canvas", {
    class: "strip",
    role: "img",
    width: WIDTH * 2,
    height: HEIGHT * 2,
    "aria-label": NAME,
  });
  const show = (importance: Importance | null, otherwise = ""): void => paint(canvas, importance, otherwise);
  return { element: canvas, show };
}

/** The next decision as text, also for screen readers. */
export function importanceText({ importance_back: back, importance_front: front }: Importance): string {
  const next = back > front ? t("the vehicle may turn back") : t("the vehicle continues");
  return t("behind {back}, ahead {front}: {next}", { back: short(back), front: short(front), next });
}

/** The importances of the nearer halves of the front behind and ahead, from the vehicle outwards. */
function sides({ cells }: Importance): [number[], number[]] {
  const values = cells.map(([, , importance]) => importance);
  const half = Math.ceil(values.length / 2);
  return [values.slice(0, half), values.slice(half).reverse()];
}

const short = (value: number): string =>
  value === 0 ? "0" : Math.abs(value) >= 100 ? value.toFixed(0) : significant(value, 3);

/** Draw the strip, or the text `otherwise` without importances. */
function paint(canvas: HTMLCanvasElement, importance: Importance | null, otherwise: string): void {
  const pen = canvas.getContext("2d");
  if (!pen) return;
  pen.setTransform(2, 0, 0, 2, 0, 0);
  pen.clearRect(0, 0, WIDTH, HEIGHT);
  pen.fillStyle = colour("--ink");
  pen.font = "bold 15px sans-serif";
  pen.textBaseline = "top";
  const middle = WIDTH / 2;
  if (!importance) {
    pen.textAlign = "center";
    pen.fillText(otherwise, middle, 54);
    canvas.setAttribute("aria-label", otherwise || NAME);
    return;
  }
  canvas.setAttribute("aria-label", importanceText(importance));
  pen.textAlign = "left";
  pen.fillStyle = colour("--behind");
  pen.fillText(`◀ ${t("behind")}`, 4, 2);
  pen.textAlign = "right";
  pen.fillStyle = colour("--ahead");
  pen.fillText(`${t("ahead")} ▶`, WIDTH - 4, 2);
  const [back, front] = sides(importance);
  const cells = Math.max(front.length, back.length, 1);
  const most = Math.max(...front, ...back, 1e-9);
  const wide = (middle - 14) / cells;
  bars(pen, back, (i) => middle - 14 - (i + 1) * wide, wide, most, colour("--behind"));
  bars(pen, front, (i) => middle + 14 + i * wide, wide, most, colour("--ahead"));
  vehicle(pen, middle);
  sums(pen, importance, middle);
}

function bars(
  pen: CanvasRenderingContext2D,
  values: number[],
  leftOf: (i: number) => number,
  wide: number,
  most: number,
  fill: string,
): void {
  pen.fillStyle = fill;
  for (const [i, value] of values.entries()) {
    const high = Math.max(1, (Math.max(0, value) / most) * (BARS_BASE - BARS_TOP));
    pen.fillRect(leftOf(i), BARS_BASE - high, Math.max(wide * 0.92, 0.6), high);
  }
}

function vehicle(pen: CanvasRenderingContext2D, x: number): void {
  pen.fillStyle = colour("--accent");
  pen.beginPath();
  pen.moveTo(x + 11, BARS_BASE - 8);
  pen.lineTo(x - 9, BARS_BASE - 18);
  pen.lineTo(x - 4, BARS_BASE - 8);
  pen.lineTo(x - 9, BARS_BASE + 2);
  pen.fill();
}

function sums(pen: CanvasRenderingContext2D, importance: Importance, middle: number): void {
  const { importance_back: back, importance_front: front } = importance;
  const most = Math.max(back, front, 1e-9);
  const side = middle - 14;
  pen.fillStyle = colour("--behind");
  pen.fillRect(middle - 14 - (side * Math.max(0, back)) / most, 90, (side * Math.max(0, back)) / most, 14);
  pen.fillStyle = colour("--ahead");
  pen.fillRect(middle + 14, 90, (side * Math.max(0, front)) / most, 14);
  pen.fillStyle = colour("--ink");
  pen.textAlign = "left";
  pen.fillText(`Σ ${short(back)}`, 4, 110);
  pen.textAlign = "right";
  pen.fillText(`Σ ${short(front)}`, WIDTH - 4, 110);
  pen.textAlign = "center";
  pen.fillText(back > front ? t("may turn back") : t("continues"), middle, 110);
}
