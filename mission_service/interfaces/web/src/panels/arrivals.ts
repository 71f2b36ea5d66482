// The list of people and values at risk that the fire may reach, the earliest first.

import { leftS, rounded } from "../arrival_layer.ts";
import { fill, h } from "../dom.ts";
import { t } from "../messages.ts";
import type { Store } from "../store.ts";
import type { FireArrival } from "../types.ts";
import { section } from "./parts.ts";

const MAX_SHOWN = 30;

/** The section, hidden while nothing is watched. */
export function arrivalsSection(store: Store): HTMLElement {
  const list = h("ul", { class: "log", "aria-label": t("When the fire arrives") });
  const element = section(t("When the fire arrives"), list);
  store.on(["fire_arrivals"], () => {
    const arrivals = store.state?.fire_arrivals ?? [];
    element.hidden = !arrivals.length;
    const reached = arrivals.filter(({ early_at_us }) => early_at_us !== null);
    const rest = arrivals.length - Math.min(reached.length, MAX_SHOWN);
    fill(list, ...reached.slice(0, MAX_SHOWN).map(row));
    if (rest) list.append(h("li", {}, t("{rest} more later, or not within the forecast", { rest })));
  });
  return element;
}

function row(each: FireArrival): HTMLElement {
  return h("li", {}, h("strong", {}, each.name), " ", words(each));
}

/** The times with probabilities of 10, 50 and 90 %. */
function words(each: FireArrival): string {
  const [early, median, late] = [each.early_at_us, each.median_at_us, each.late_at_us].map((at) => leftS(at, each));
  if (early !== null && early !== undefined && early <= 0) return t("the fire may be there now");
  const parts = [t("possible in {time}", { time: rounded(early ?? 0) })];
  if (median !== null && median !== undefined) parts.push(t("expected in {time}", { time: rounded(Math.max(median, 0)) }));
  if (late !== null && late !== undefined) parts.push(t("almost certain in {time}", { time: rounded(Math.max(late, 0)) }));
  return parts.join(", ");
}
