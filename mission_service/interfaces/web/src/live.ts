// The live stream: server-sent events, read by fetch because EventSource cannot send a token.

export interface StreamEvent {
  event: string;
  id: string;
  data: string;
}

/** Splits received text into events and stores an incomplete event; ignores comments. */
export class EventReader {
  private rest = "";

  read(text: string): StreamEvent[] {
    const blocks = (this.rest + text).replaceAll("\r\n", "\n").split("\n\n");
    this.rest = blocks.pop() ?? "";
    return blocks.map(eventOf).filter((event) => event.data !== "");
  }
}

function eventOf(block: string): StreamEvent {
  const found: StreamEvent = { event: "message", id: "", data: "" };
  const data: string[] = [];
  for (const line of block.split("\n")) {
    const colon = line.indexOf(":");
    if (colon <= 0) continue;
    const value = line.slice(colon + 1).replace(/^ /, "");
    const field = line.slice(0, colon);
    if (field === "data") data.push(value);
    else if (field === "event") found.event = value;
    else if (field === "id") found.id = value;
  }
  found.data = data.join("\n");
  return found;
}

/** Seconds before the next attempt to connect: 0.5, 1, 2, 4, then 5. */
export const backoffS = (failures: number): number => Math.min(5, 0.5 * 2 ** Math.max(0, failures - 1));
