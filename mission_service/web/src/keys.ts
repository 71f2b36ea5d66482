// Keyboard shortcuts: one table, which "?" shows too.

export interface Shortcut {
  keys: string; // as event.key, with "Ctrl+Shift+" before it
  does: string;
  act: () => void;
  inFields?: boolean; // also while somebody types
}

const shortcuts: Shortcut[] = [];

export function shortcut(keys: string, does: string, act: () => void, inFields = false): void {
  shortcuts.push({ keys, does, act, inFields });
}

export const allShortcuts = (): readonly Shortcut[] => shortcuts;

/** The name of a key press as the table has it. */
export function nameOf(event: KeyboardEvent): string {
  const chord = (event.ctrlKey || event.metaKey ? "Ctrl+" : "") + (event.altKey ? "Alt+" : "");
  const key = event.key.length === 1 && chord ? event.key.toUpperCase() : event.key;
  const shift = event.shiftKey && (chord || event.key.length > 1) ? "Shift+" : "";
  return chord + shift + (key === " " ? "Space" : key);
}

const isField = (target: EventTarget | null): boolean =>
  target instanceof HTMLElement && target.matches("input:not([type=range]):not([type=checkbox]), select, textarea");

export function listenForKeys(): void {
  document.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || event.repeat) return;
    const name = nameOf(event);
    const found = shortcuts.find(
      (one) => one.keys === name && (one.inFields || !isField(event.target)),
    );
    if (!found) return;
    event.preventDefault();
    found.act();
  });
}
