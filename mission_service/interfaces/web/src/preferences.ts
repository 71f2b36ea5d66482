// What a user has chosen in this browser: units, colours of the page, basemap. Stored in localStorage.

import { t } from "./messages.ts";
export const UNITS = { metric: t("Metric"), us: t("US"), aviation: t("Aviation") } as const;
export const THEMES = { auto: t("As the system"), day: t("Day"), night: t("Night"), contrast: t("High contrast") } as const;

export const BASEMAPS = { topo: t("Topo"), imagery: t("Imagery"), hillshade: t("Hillshade") } as const;

export type Units = keyof typeof UNITS;
export type Theme = keyof typeof THEMES;
export type Basemap = keyof typeof BASEMAPS;

const KEYS = { units: "mission-service-units", theme: "mission-service-theme", basemap: "mission-service-basemap" } as const;
const DARK = matchMedia("(prefers-color-scheme: dark)");

function stored<Choice extends string>(key: string, choices: Record<Choice, string>, otherwise: Choice): Choice {
  const found = localStorage.getItem(key);
  return found !== null && found in choices ? (found as Choice) : otherwise;
}

let units: Units = stored(KEYS.units, UNITS, "metric");
let theme: Theme = stored(KEYS.theme, THEMES, "auto");
let basemap: Basemap = stored(KEYS.basemap, BASEMAPS, "topo");
const listeners: (() => void)[] = [];

export const chosenUnits = (): Units => units;
export const chosenBasemap = (): Basemap => basemap;
export const chosenTheme = (): Theme => theme;

/** The colours in use: those of the chosen theme, or of the system. */
export const shownTheme = (): Exclude<Theme, "auto"> => (theme !== "auto" ? theme : DARK.matches ? "night" : "day");

/** Call `act` after each change of a preference. */
export function onPreferences(act: () => void): void {
  listeners.push(act);
}

export function chooseUnits(chosen: Units): void {
  units = chosen;
  localStorage.setItem(KEYS.units, chosen);
  changed();
}

export function chooseTheme(chosen: Theme): void {
  theme = chosen;
  localStorage.setItem(KEYS.theme, chosen);
  changed();
}

export function chooseBasemap(chosen: Basemap): void {
  basemap = chosen;
  localStorage.setItem(KEYS.basemap, chosen);
  changed();
}

function changed(): void {
  applyTheme();
  for (const act of listeners) act();
}

/** Show the colours of the theme, which are variables of the style sheet. */
export function applyTheme(): void {
  document.documentElement.dataset.theme = shownTheme();
}

DARK.addEventListener("change", changed);
applyTheme();

/** The value of a colour of the theme, for canvases: `--ink`. */
export const colour = (name: string): string => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
