// Requests to the service with the token; errors become one line of text.

import { t } from "./messages.ts";
import { forgetToken, token } from "./token.ts";

export const BASE = new URL("api/v1/", document.baseURI).href;

const MAX_KEPT_ALIVE = 32_000;

/** The service refused a request; the message is its reason. */
export class Refused extends Error {
  constructor(readonly status: number, message: string) {
    super(message);
  }
}

let onUnauthorised: () => void = () => undefined;

/** Set the action for an invalid token. */
export function whenUnauthorised(act: () => void): void {
  onUnauthorised = act;
}

export const headers = (): Record<string, string> => ({ Authorization: `Bearer ${token()}` });

/** Request `path` below /api/v1. Throws Refused, or TypeError without a connection. */
export async function ask(path: string, init: RequestInit = {}): Promise<Response> {
  const response = await fetch(BASE + path, {
    cache: "no-store",
    ...init,
    headers: { ...headers(), ...(init.headers as Record<string, string> | undefined) },
  });
  if (response.ok) return response;
  if (response.status === 401) {
    forgetToken();
    onUnauthorised();
  }
  throw new Refused(response.status, await reasonOf(response));
}

async function reasonOf(response: Response): Promise<string> {
  const text = await response.text();
  try {
    const body = JSON.parse(text) as { error?: unknown; detail?: unknown };
    const reason = body.error ?? body.detail;
    if (typeof reason === "string") return reason;
    if (reason !== undefined) return JSON.stringify(reason);
  } catch {
    // not JSON: the text is the reason
  }
  return text.trim().slice(0, 300) || `${response.status} ${response.statusText}`;
}

/** Return the JSON at `path`. */
export async function get<T>(path: string, signal?: AbortSignal): Promise<T> {
  const response = await ask(path, signal ? { signal } : {});
  return (await response.json()) as T;
}

/** Send a request that changes something; returns the reply. */
export async function post<T = { messages?: string[] }>(
  path: string, body: object = {}, method = "POST", signal: AbortSignal | null = null,
): Promise<T> {
  const text = JSON.stringify(body);
  const response = await ask(path, {
    method,
    headers: { "Content-Type": "application/json" },
    body: text,
    // The browser sends the request even if the page is closed, for bodies of at most 64 kB.
    keepalive: text.length < MAX_KEPT_ALIVE,
    signal,
  });
  return (await response.json()) as T;
}

/** Save the content at `path` as a file. */
export async function download(path: string, name: string): Promise<void> {
  const blob = await (await ask(path)).blob();
  const address = URL.createObjectURL(blob);
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** The text of an error, in one line. */
export function errorText(error: unknown): string {
  if (error instanceof Refused) return error.message;
  if (error instanceof TypeError) return t("no connection to the service");
  if (error instanceof DOMException && error.name === "TimeoutError") return t("no response from the service");
  return error instanceof Error ? error.message : String(error);
}
