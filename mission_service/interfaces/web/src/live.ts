// The stream of changes: server-sent events read by fetch, for EventSource cannot send a token.

export interface StreamEvent {
  event: string;
  id: string;
  data: string;
}

/** Cuts what comes into events; keeps what is not whole yet. Comments are heard, not told. */
export class EventReader {
  private rest = "";

  take(text: string): StreamEvent[] {
    const blocks = (this.rest + text).replaceAll("\r\n", "\n").split("\n\n");
    this.rest = blocks.pop() ?? "";
    return blocks.map(eventOf).filter((event) => event.data !== "");
  }
}

function eventOf(block: string): StreamEvent {
  const told: StreamEvent = { event: "message", id: "", data: "" };
  const data: string[] = [];
  for (const line of block.split("\n")) {
    const colon = line.indexOf(":");
    if (colon <= 0) continue;
    const value = line.slice(colon + 1).replace(/^ /, "");
    const field = line.slice(0, colon);
    if (field === "data") data.push(value);
    else if (field === "event") told.event = value;
    else if (field === "id") told.id = value;
  }
  told.data = data.join("\n");
  return told;
}

/** Seconds to wait before the next try: 0.5, 1, 2, 4, then 5. */
export const backoffS = (failures: number): number => Math.min(5, 0.5 * 2 ** Math.max(0, failures - 1));
