// The question before a correction that changes much of the fire, and the new outline on the map.

import { Refused } from "./api.ts";
import { confirmed } from "./dialogs.ts";
import { t } from "./messages.ts";
import type { Store } from "./store.ts";
import { area } from "./units.ts";

const MAX_CHANGE = 0.05; // share of the burned area; larger changes need a confirmation
const M2_PER_HA = 10_000;

/** The burned area before and after a correction that is not applied. */
export interface Preview {
  burned_ha_before: number;
  burned_ha_after: number;
  front: GeoJSON.Feature;
}

/** Ask about a correction that would change more than 5 % of the area; return whether to send it. */
export async function acceptsChange(store: Store, preview: () => Promise<Preview>): Promise<boolean> {
  const found = await available(preview);
  if (!found) return true;
  const { burned_ha_before: before, burned_ha_after: after } = found;
  if (before === 0 || Math.abs(after - before) <= MAX_CHANGE * before) return true;
  store.showPreview(found.front);
  try {
    return await confirmed(question(before, after));
  } finally {
    store.showPreview(null);
  }
}

/** The preview; null if the service has no previews (in a burn). */
async function available(preview: () => Promise<Preview>): Promise<Preview | null> {
  try {
    return await preview();
  } catch (error) {
    if (error instanceof Refused && error.status === 409) return null;
    throw error;
  }
}

function question(beforeHa: number, afterHa: number): string {
  const change = Math.round((100 * (afterHa - beforeHa)) / beforeHa);
  const sign = change > 0 ? "+" : "−";
  const percent = `${sign}${Math.abs(change)}`;
  const [before, after] = [area(beforeHa * M2_PER_HA), area(afterHa * M2_PER_HA)];
  return t("The burned area changes from {before} to {after} ({percent} %). The map shows the new outline in blue. Apply this correction?", { before, after, percent });
}
