// Elements that all panels use.

import { h } from "../dom.ts";
import type { Group } from "../map.ts";

export type Toggle = (group: string, shown: boolean) => void;

const BUSY_MS = 5000;

/** A button. Until the promise of a press is settled, but at most for BUSY_MS, further presses have no effect. */
export function button(label: string, act: () => Promise<unknown> | void, title = "", kind = ""): HTMLButtonElement {
  const press = async (): Promise<void> => {
    if (made.hasAttribute("aria-disabled")) return;
    const work = act();
    if (!work) return;
    made.setAttribute("aria-disabled", "true"); // with `disabled` the button would lose the focus
    await Promise.race([work, new Promise((done) => setTimeout(done, BUSY_MS))]);
    made.removeAttribute("aria-disabled");
  };
  const made = h("button", { type: "button", onclick: () => void press(), title, class: kind }, label);
  return made;
}

/** Let the buttons in an element have effect, because further presses concern something else. */
export function releaseButtons(element: HTMLElement): void {
  for (const each of element.querySelectorAll("[aria-disabled]")) each.removeAttribute("aria-disabled");
}

/** A checkbox that shows and hides a group of layers; `toggle` sets all checkboxes of the group. */
export function layerBox(key: string, { label, shown }: Group, toggle: Toggle, id: string): HTMLElement {
  const change = (event: Event): void => toggle(key, (event.target as HTMLInputElement).checked);
  const box = h("input", { type: "checkbox", checked: shown, id, "data-layers": key, onchange: change });
  return h("label", { class: "check", "data-group": key }, box, label);
}

/** A list of names and values, without the rows whose value is null. */
export function figures(rows: [string, string | null][]): HTMLElement {
  const list = h("dl", { class: "figures" });
  for (const [name, value] of rows) {
    if (value !== null) list.append(h("dt", {}, name), h("dd", {}, value));
  }
  return list;
}

/** The colours of a legend side by side, with their texts. */
export function scaleBar(entries: [string, string][]): HTMLElement {
  const bar = h("span", { class: "scale" });
  for (const [text, colour] of entries) {
    const step = h("i");
    step.style.background = colour; // a script: the policy permits no style in markup
    bar.append(h("span", {}, step, text));
  }
  return bar;
}

export function section(title: string, ...children: (Node | string)[]): HTMLElement {
  return h("section", {}, h("h3", {}, title), ...children);
}
