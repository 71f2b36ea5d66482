// Creation of elements. Text is never interpreted as markup.

type Child = Node | string | number | null | undefined | false;
type Attributes = Record<string, unknown>;

/** Create an element: `on…` are listeners, all others attributes; false omits an attribute. */
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

/** Set a text if it differs: an unchanged text must not affect screen readers and layout. */
export function setText(element: Element, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

/** Return the element with an id. */
export function byId(id: string): HTMLElement {
  const element = document.getElementById(id);
  if (element === null) throw new Error(`the page has no #${id}`);
  return element;
}

/** Disable a control and show the reason as its title; an empty reason enables it. */
export function setReason(control: HTMLButtonElement | HTMLInputElement, reason: string): void {
  control.disabled = reason !== "";
  if (reason) {
    if (control.dataset.title === undefined) control.dataset.title = control.title;
    control.title = reason;
  } else if (control.dataset.title !== undefined) {
    control.title = control.dataset.title;
  }
}
