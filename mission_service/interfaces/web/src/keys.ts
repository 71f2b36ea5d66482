// Keyboard shortcuts: one table, which "?" shows too.

export interface Shortcut {
  keys: string; // as event.key, with "Ctrl+Shift+" before it
  does: string;
  act: () => void;
  inFields?: boolean; // also while somebody types
  there: () => boolean; // whether it does anything in this run
}

const shortcuts: Shortcut[] = [];

export function shortcut(
  keys: string,
  does: string,
  act: () => void,
  inFields = false,
  there: () => boolean = () => true,
): void {
  shortcuts.push({ keys, does, act, inFields, there });
}

export const allShortcuts = (): readonly Shortcut[] => shortcuts.filter((one) => one.there());

/** The name of a key press as the table has it. */
export function nameOf(event: KeyboardEvent): string {
  const chord = (event.ctrlKey || event.metaKey ? "Ctrl+" : "") + (event.altKey ? "Alt+" : "");
  const key = event.key.length === 1 && chord ? event.key.toUpperCase() : event.key;
  const shift = event.shiftKey && (chord || event.key.length > 1) ? "Shift+" : "";
  return chord + shift + (key === " " ? "Space" : key);
}

const isField = (target: EventTarget | null): boolean =>
  target instanceof HTMLElement && target.matches("input:not([type=range]):not([type=checkbox]), select, textarea");

// What buttons, sliders and the map do themselves with a key is theirs.
const TAKEN: [RegExp, string][] = [
  [/^Space$/, "button, a, summary, input, select"],
  [/^Arrow/, "input, select, canvas, [role=tab]"],
];

const takes = (target: EventTarget | null, name: string): boolean =>
  target instanceof HTMLElement && TAKEN.some(([keys, who]) => keys.test(name) && target.matches(who));

export function listenForKeys(): void {
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.repeat) return;
    const name = nameOf(event);
    if (takes(event.target, name)) return;
    const found = shortcuts.find(
      (one) => one.keys === name && one.there() && (one.inFields || !isField(event.target)),
    );
    if (!found) return;
    event.preventDefault();
    found.act();
  });
}
