// The dialog of the display settings: units, colours of the page, and basemap.

import { byId, fill, h } from "./dom.ts";
import { offeredBasemaps } from "./basemaps.ts";
import { chooseLanguage, LANGUAGES, shownLanguage, t } from "./messages.ts";
import { button } from "./panels/parts.ts";
import {
  BASEMAPS, chooseBasemap, chooseTheme, chooseUnits, chosenBasemap, chosenTheme, chosenUnits, THEMES, UNITS,
} from "./preferences.ts";
import { showTour } from "./tour.ts";

/** Open the display settings, or close them. */
export function showDisplay(): void {
  const dialog = byId("display") as HTMLDialogElement;
  if (dialog.open) return dialog.close();
  const offered = offeredBasemaps();
  const basemaps = Object.fromEntries(offered.map((key) => [key, BASEMAPS[key]])) as typeof BASEMAPS;
  const close = h("button", { type: "button", class: "primary", onclick: () => dialog.close() }, t("Close"));
  fill(
    dialog,
    h("div", { class: "row head" }, h("h2", {}, t("Display")), close),
    choice(t("Language"), LANGUAGES, shownLanguage(), chooseLanguage),
    choice(t("Units"), UNITS, chosenUnits(), chooseUnits),
    choice(t("Colours"), THEMES, chosenTheme(), chooseTheme),
    choice(t("Basemap"), basemaps, offered.includes(chosenBasemap()) ? chosenBasemap() : offered[0]!, chooseBasemap),
    h("div", { class: "row" }, button(t("Tour of the map"), () => {
      dialog.close();
      showTour();
    })),
  );
  dialog.show(); // not modal: the abort button remains accessible
  close.focus();
}

/** A group of buttons, of which one is pressed. */
export function choice<Choice extends string>(
  title: string, choices: Record<Choice, string>, chosen: Choice, choose: (chosen: Choice) => void,
): HTMLElement {
  const buttons = Object.entries<string>(choices).map(([key, label]) => {
    const button = h("button", { type: "button", "aria-pressed": String(key === chosen) }, label);
    button.addEventListener("click", () => {
      for (const each of buttons) each.setAttribute("aria-pressed", String(each === button));
      choose(key as Choice);
    });
    return button;
  });
  return h("fieldset", {}, h("legend", {}, title), h("div", { class: "row" }, ...buttons));
}
