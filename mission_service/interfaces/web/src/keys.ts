// Keyboard shortcuts: one table, which "?" displays.

export interface Shortcut {
  keys: string; // as event.key, with a prefix like "Ctrl+Shift+"
  does: string;
  act: () => void;
  inFields: boolean; // active also while a text field has the focus
  available: () => boolean; // whether this run has the function
}

const shortcuts: Shortcut[] = [];

export function shortcut(
  keys: string,
  does: string,
  act: () => void,
  inFields = false,
  available: () => boolean = () => true,
): void {
  shortcuts.push({ keys, does, act, inFields, available });
}

export const allShortcuts = (): readonly Shortcut[] => shortcuts.filter((one) => one.available());

/** The name of a key press in the table; Caps Lock makes no difference. */
export function nameOf(event: KeyboardEvent): string {
  const chord = (event.ctrlKey || event.metaKey ? "Ctrl+" : "") + (event.altKey ? "Alt+" : "");
  const isUpper = chord !== "" || event.shiftKey;
  const key = event.key.length > 1 ? event.key : isUpper ? event.key.toUpperCase() : event.key.toLowerCase();
  const shift = event.shiftKey && (chord || event.key.length > 1) ? "Shift+" : "";
  return chord + shift + (key === " " ? "Space" : key);
}

const isField = (target: EventTarget | null): boolean =>
  target instanceof HTMLElement && target.matches("input:not([type=range]):not([type=checkbox]), select, textarea");

// Keys that buttons, sliders and the map handle themselves.
const HANDLED: [RegExp, string][] = [
  [/^Space$/, "button, a, summary, input, select"],
  [/^Arrow/, "input, select, canvas, [role=tab]"],
];

const handles = (target: EventTarget | null, name: string): boolean =>
  target instanceof HTMLElement && HANDLED.some(([keys, controls]) => keys.test(name) && target.matches(controls));

export function listenForKeys(): void {
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.repeat) return;
    const name = nameOf(event);
    if (handles(event.target, name)) return;
    const found = shortcuts.find(
      (one) => one.keys === name && one.available() && (one.inFields || !isField(event.target)),
    );
    if (!found) return;
    event.preventDefault();
    found.act();
  });
}
