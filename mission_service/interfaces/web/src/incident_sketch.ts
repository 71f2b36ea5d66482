// A sketch of the positions in the form: the area, ignitions and homes, north up and to scale.

export interface Sketched {
  area: [number, number, number, number] | null; // west, south, east, north in degrees
  ignitions: [number, number][]; // latitude, longitude
  homes: { name: string; place: [number, number] }[];
}

const [HEIGHT, MARGIN] = [240, 24]; // px

function shape(name: string, attributes: Record<string, string | number>, text = ""): SVGElement {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, String(value));
  element.textContent = text;
  return element;
}

/** Draw all positions into an SVG element; hide the element if there are none. */
export function draw(svg: Element, { area, ignitions, homes }: Sketched): void {
  const corners: [number, number][] = area ? [[area[1], area[0]], [area[3], area[2]]] : [];
  const all = [...corners, ...ignitions, ...homes.map(({ place }) => place)];
  svg.toggleAttribute("hidden", all.length === 0);
  if (all.length === 0) return;
  const width = svg.clientWidth || 800;
  const lats = all.map(([lat]) => lat);
  const lons = all.map(([, lon]) => lon);
  const [south, north, west, east] = [Math.min(...lats), Math.max(...lats), Math.min(...lons), Math.max(...lons)];
  const narrow = Math.cos(((south + north) / 2) * (Math.PI / 180));
  const scale = Math.min(
    (width - 2 * MARGIN) / Math.max((east - west) * narrow, 1e-6),
    (HEIGHT - 2 * MARGIN) / Math.max(north - south, 1e-6),
  );
  const x = (lon: number): number => width / 2 + (lon - (west + east) / 2) * narrow * scale;
  const y = (lat: number): number => HEIGHT / 2 - (lat - (south + north) / 2) * scale;
  const shapes: SVGElement[] = [];
  if (area) {
    const [left, bottom, right, top] = area;
    const size = { x: x(left), y: y(top), width: x(right) - x(left), height: y(bottom) - y(top) };
    shapes.push(shape("rect", { class: "area", ...size }));
  }
  for (const [lat, lon] of ignitions) shapes.push(shape("circle", { class: "fire", cx: x(lon), cy: y(lat), r: 7 }));
  for (const { name, place: [lat, lon] } of homes) {
    shapes.push(shape("rect", { class: "home", x: x(lon) - 6, y: y(lat) - 6, width: 12, height: 12 }));
    const left = x(lon) > width - 120;
    shapes.push(shape("text", { "x": x(lon) + (left ? -10 : 10), "y": y(lat) + 5, "text-anchor": left ? "end" : "start" }, name));
  }
  svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
  svg.replaceChildren(...shapes);
}
