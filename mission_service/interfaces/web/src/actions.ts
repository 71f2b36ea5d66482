// Things people ask for: said in a line whether they were done, and why not.

import { wordsOf } from "./api.ts";
import { byId } from "./dom.ts";
import type { Store } from "./store.ts";
import type { Role } from "./types.ts";

const SHOWN_MS = 6000;
let timer = 0;

/** Say a line to who looks and who listens; errors stay until the next line. */
export function say(words: string, bad = false): void {
  const element = byId("said");
  element.textContent = words;
  element.className = bad ? "bad shown" : "shown";
  clearTimeout(timer);
  if (!bad) timer = window.setTimeout(() => element.classList.remove("shown"), SHOWN_MS);
}

/** Do something and say what came of it; whether it was done. */
export async function attempt(
  words: string,
  work: () => Promise<{ messages?: string[] } | void>,
): Promise<boolean> {
  try {
    const answer = await work();
    const said = (answer?.messages ?? []).join("; ");
    say(said ? `${words}: ${said}` : `${words}: done`);
    return true;
  } catch (error) {
    say(`${words}: failed: ${wordsOf(error)}`, true);
    return false;
  }
}

const WORDS: Record<Role, string> = {
  look: "look",
  correct: "correct the fire",
  fly: "command vehicles",
  approve: "approve drops",
};

/** Why nobody may order anything here, or this token not what takes a role; "" if it may. */
export function lacking(store: Store, role: Role): string {
  return store.state?.replay ? "A replay accepts no orders" : withoutRole(store, role);
}

/** Why this token may not do what takes a role; "" if it may. */
export function withoutRole(store: Store, role: Role): string {
  const roles = store.state?.roles ?? [];
  if (roles.includes(role)) return "";
  return `Your token may not ${WORDS[role]}: it lacks the role "${role}"`;
}
