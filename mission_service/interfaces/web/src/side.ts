// The side bar with panels as tabs, of which one is visible.

import { byId, h } from "./dom.ts";
import { shortcut } from "./keys.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";

export interface Tab {
  key: string;
  label: string;
  element: HTMLElement;
  available: () => boolean;
}

/** Make the side bar; returns the function that opens a panel by its key. */
export function side(store: Store, tabs: Tab[]): (key: string) => void {
  const buttons = tabs.map(({ key, label }, i) => {
    const button = h(
      "button",
      {
        type: "button",
        role: "tab",
        id: `tab-${key}`,
        "aria-controls": `panel-${key}`,
        title: `${label} (Alt+${i + 1})`,
        onclick: () => open(key),
      },
      label,
    );
    shortcut(`Alt+${i + 1}`, t("Panel: {label}", { label }), () => {
      open(key);
      button.focus();
    });
    return button;
  });
  const list = h("div", { role: "tablist", class: "tabs" }, ...buttons);
  list.addEventListener("keydown", (event) => {
    const by = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    const visible = buttons.filter((button) => !button.hidden);
    const at = visible.findIndex((button) => button === document.activeElement);
    if (!by || at < 0) return;
    const next = visible[(at + by + visible.length) % visible.length];
    next?.click();
    next?.focus();
  });
  for (const { key, element } of tabs) {
    element.id = `panel-${key}`;
    element.setAttribute("role", "tabpanel");
    element.setAttribute("aria-labelledby", `tab-${key}`);
    element.tabIndex = 0;
  }
  byId("side").append(list, ...tabs.map((tab) => tab.element));

  const open = (key: string): void => {
    for (const [i, tab] of tabs.entries()) {
      const chosen = tab.key === key;
      tab.element.hidden = !chosen;
      buttons[i]!.setAttribute("aria-selected", String(chosen));
      buttons[i]!.tabIndex = chosen ? 0 : -1;
    }
    store.changed("chosen");
  };
  open(tabs[0]!.key);
  let first = true;
  store.on(["burn"], () => {
    for (const [i, tab] of tabs.entries()) buttons[i]!.hidden = !tab.available();
    if (first && store.state?.burn) open("burn");
    first = false;
  });
  return open;
}
