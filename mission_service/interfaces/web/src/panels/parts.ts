// Elements that all panels use.

import { h } from "../dom.ts";

export function button(label: string, act: () => void, title = "", kind = ""): HTMLButtonElement {
  return h("button", { type: "button", onclick: act, title, class: kind }, label);
}

/** A list of names and values, without the rows whose value is null. */
export function figures(rows: [string, string | null][]): HTMLElement {
  const list = h("dl", { class: "figures" });
  for (const [name, value] of rows) {
    if (value !== null) list.append(h("dt", {}, name), h("dd", {}, value));
  }
  return list;
}

export function section(title: string, ...children: (Node | string)[]): HTMLElement {
  return h("section", {}, h("h3", {}, title), ...children);
}
