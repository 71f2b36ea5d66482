// Making elements. Text only ever becomes text, never markup.

type Child = Node | string | number | null | undefined | false;
type Attributes = Record<string, unknown>;

/** An element: `on…` are listeners, `class` and `aria-…` attributes, true and false switch them. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) {
      element.addEventListener(name.slice(2), value as EventListener);
    } else if (value === true) {
      element.setAttribute(name, "");
    } else if (value !== false && value !== null && value !== undefined) {
      element.setAttribute(name, String(value));
    }
  }
  fill(element, ...children);
  return element;
}

/** Replace all children. */
export function fill(element: Element, ...children: Child[]): void {
  element.replaceChildren(
    ...children
      .filter((child) => child !== null && child !== undefined && child !== false)
      .map((child) => (typeof child === "number" ? String(child) : (child as Node | string))),
  );
}

/** Set a text only where it changes: screen readers and layout are left alone otherwise. */
export function setText(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

/** The element of this id in the page. */
export function byId(id: string): HTMLElement {
  const element = document.getElementById(id);
  if (element === null) throw new Error(`the page has no #${id}`);
  return element;
}

/** Switch a control off, saying why; no reason switches it on. */
export function setReason(control: HTMLButtonElement | HTMLInputElement, reason: string): void {
  control.disabled = reason !== "";
  if (reason) {
    if (control.dataset.title === undefined) control.dataset.title = control.title;
    control.title = reason;
  } else if (control.dataset.title !== undefined) {
    control.title = control.dataset.title;
  }
}
