// What panels are made of.

import { h } from "../dom.ts";

export function button(
  words: string,
  act: () => void,
  title = "",
  kind = "",
): HTMLButtonElement {
  return h("button", { type: "button", onclick: act, title, class: kind }, words);
}

/** Figures as a list of names and values; null leaves a row out. */
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
