// A click is lost if its element is replaced between the press and the release. Elements are therefore not
// replaced while a pointer presses them.

let pressed: Node | null = null;
const waiting = new Map<Element, () => void>();

/** Run a job that replaces parts of `element`: now, or as soon as no pointer presses on a part of it. */
export function whenReleased(element: Element, job: () => void): void {
  if (pressed && element.contains(pressed)) waiting.set(element, job); // in place of an earlier job
  else {
    waiting.delete(element);
    job();
  }
}

function release(): void {
  pressed = null;
  const jobs = [...waiting.values()];
  waiting.clear();
  for (const job of jobs) job();
}

addEventListener("pointerdown", (event) => {
  if (event.button === 0) pressed = event.target as Node;
}, true);
// The listeners of a clicked element are called even if the element is replaced here.
addEventListener("click", release, true);
addEventListener("pointerup", () => setTimeout(release), true); // without a click
for (const end of ["pointercancel", "contextmenu"]) addEventListener(end, release, true);
addEventListener("blur", release); // of the window: a blur of an element does not bubble
