// Requests of the operator, each with a message about its result.

import { errorText } from "./api.ts";
import { byId, fill, h } from "./dom.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";
import type { Role } from "./types.ts";

const SHOWN_MS = 6000;
const SHOWN_WITH_UNDO_MS = 15_000;
let timer = 0;

/** The result of an operator's request: messages of the service, and how to undo it. */
export interface Result {
  messages?: string[];
  undo?: () => void;
}

/** Show a message, also to screen readers; errors stay until the next message. */
export function showMessage(text: string, bad = false, undo?: () => void): void {
  const element = byId("message");
  fill(element, text);
  if (undo) element.append(h("button", { type: "button", onclick: undo }, t("Undo")));
  element.className = bad ? "bad shown" : "shown";
  clearTimeout(timer);
  const shownMs = undo ? SHOWN_WITH_UNDO_MS : SHOWN_MS;
  if (!bad) timer = window.setTimeout(() => element.classList.remove("shown"), shownMs);
}

/** Send a request and show the result; returns whether it succeeded. */
export async function attempt(action: string, work: () => Promise<Result | void>): Promise<boolean> {
  try {
    const answer = await work();
    showMessage(`${action}: ${(answer?.messages ?? []).join("; ") || t("done")}`, false, answer?.undo);
    return true;
  } catch (error) {
    showMessage(t("{action}: failed: {reason}", { action, reason: errorText(error) }), true);
    return false;
  }
}

const PERMISSIONS: Record<Role, string> = {
  look: t("look"),
  observe: t("report observations"),
  correct: t("correct the fire"),
  fly: t("command vehicles"),
  approve: t("approve drops"),
};

/** The reason why a request with a role is impossible (a replay, or the token); "" if possible. */
export function lacking(store: Store, role: Role): string {
  return store.state?.replay ? t("A replay accepts no orders") : withoutRole(store, role);
}

/** The reason why the token does not permit requests with a role; "" if it permits them. */
export function withoutRole(store: Store, role: Role): string {
  const roles = store.state?.roles ?? [];
  if (roles.includes(role)) return "";
  return t("Your token does not permit you to {action}: it does not have the role \"{role}\"", { action: PERMISSIONS[role], role });
}
