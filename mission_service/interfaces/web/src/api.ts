// Requests to the service: the token goes along, errors become one line for people.

import { forgetToken, token } from "./token.ts";

export const BASE = new URL("api/v1/", document.baseURI).href;

const MAX_KEPT_ALIVE = 32_000;

/** What the service said when it did not do what was asked. */
export class Refused extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

let onUnauthorised: () => void = () => undefined;

/** What is to be done when the service does not know the token. */
export function whenUnauthorised(act: () => void): void {
  onUnauthorised = act;
}

export const headers = (): Record<string, string> => ({ Authorization: `Bearer ${token()}` });

/** Ask for `path` below /api/v1; raises Refused, or TypeError where the service is not reached. */
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
    const said = body.error ?? body.detail;
    if (typeof said === "string") return said;
    if (said !== undefined) return JSON.stringify(said);
  } catch {
    // not JSON: the text itself is the reason
  }
  return text.trim().slice(0, 300) || `${response.status} ${response.statusText}`;
}

/** The JSON at `path`. */
export async function get<T>(path: string, signal?: AbortSignal): Promise<T> {
  const response = await ask(path, signal ? { signal } : {});
  return (await response.json()) as T;
}

/** Ask for something to be done; the answer is what was said to it. */
export async function post<T = { messages?: string[] }>(
  path: string,
  body: object = {},
  method = "POST",
): Promise<T> {
  const text = JSON.stringify(body);
  const response = await ask(path, {
    method,
    headers: { "Content-Type": "application/json" },
    body: text,
    // Sent though the page is closed or left meanwhile; browsers do that for 64 kB at most.
    keepalive: text.length < MAX_KEPT_ALIVE,
  });
  return (await response.json()) as T;
}

/** Have the browser keep what is at `path` as a file. */
export async function download(path: string, name: string): Promise<void> {
  const blob = await (await ask(path)).blob();
  const address = URL.createObjectURL(blob);
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** What went wrong, in one line. */
export function wordsOf(error: unknown): string {
  if (error instanceof Refused) return error.message;
  if (error instanceof TypeError) return "no connection to the service";
  return error instanceof Error ? error.message : String(error);
}
