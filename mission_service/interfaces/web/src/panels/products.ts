// The button that downloads maps and files of the fire for crews and incident staff.

import { attempt, showMessage } from "../actions.ts";
import { ask, Refused } from "../api.ts";
import { h } from "../dom.ts";
import { t } from "../messages.ts";
import type { Store } from "../store.ts";
import { button, section } from "./parts.ts";

const RELEASED_MS = 60_000;

/** The section with the button; the products take up to a minute. */
export function productsSection(store: Store): HTMLElement {
  const make = button(t("Download maps and files"), () => void download(), t("PDF and PNG maps, KMZ, GeoPackage, Shapefile, GeoTIFF"));
  const download = async (): Promise<void> => {
    make.disabled = true;
    showMessage(t("The service makes the products; this takes up to a minute"));
    await attempt(t("Products"), async () => {
      const answer = await made(store);
      const link = h("a", { href: URL.createObjectURL(await answer.blob()), download: "products.zip" });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), RELEASED_MS);
      showMessage(t("The products were saved as products.zip"));
    });
    make.disabled = false;
  };
  return section(t("For crews and incident staff"), make);
}

/** The products; without a `time_zero` of the scenario, calendar times follow from the present time of the service. */
async function made(store: Store): Promise<Response> {
  try {
    return await ask("products.zip");
  } catch (error) {
    const status = store.state?.status;
    if (!status || !(error instanceof Refused && error.message.includes("time_zero"))) throw error;
    const zero = new Date((status.time_unix_us - status.at_us) / 1000).toISOString();
    return await ask(`products.zip?${new URLSearchParams({ time_zero: zero }).toString()}`);
  }
}
