// Texts of the page in the chosen language: ICU messages (intl-messageformat) with the English text as key. The file of
// a language is loaded before the first text is shown. Texts that the service writes (log, reasons) stay English; its
// fixed words (states, phases, orders) are in the table of `word`.

import { IntlMessageFormat } from "intl-messageformat";

export const LANGUAGES = { en: "English", es: "Español", pt: "Português" } as const;
export type Language = keyof typeof LANGUAGES;

const KEY = "mission-service-language";
const isLanguage = (name: string | null | undefined): name is Language => Boolean(name && name in LANGUAGES);

/** The chosen language, otherwise the first language of the browser that the page has. */
function foundLanguage(): Language {
  const chosen = localStorage.getItem(KEY);
  if (isLanguage(chosen)) return chosen;
  return navigator.languages.map((each) => each.slice(0, 2)).find(isLanguage) ?? "en";
}

const language: Language = foundLanguage();
/** The language with the region of the browser, for numbers: "es-MX". */
const locale = navigator.languages.find((each) => each.slice(0, 2) === language) ?? language;

type Messages = Record<string, string>;
const FILES: Record<Exclude<Language, "en">, () => Promise<{ default: Messages }>> = {
  es: () => import("./languages/es.json"),
  pt: () => import("./languages/pt.json"),
};
const messages: Messages = language === "en" ? {} : (await FILES[language]()).default;
const formats = new Map<string, IntlMessageFormat>();

export const shownLanguage = (): Language => language;

/** Remember a language and show the page in it: all texts are made again. */
export function chooseLanguage(chosen: Language): void {
  localStorage.setItem(KEY, chosen);
  location.reload();
}

/** A text in the chosen language; `values` are its arguments. */
export function t(text: string, values?: Record<string, string | number>): string {
  if (!values && language === "en") return text;
  const translated = language === "en" ? text : messages[text];
  if (translated === undefined) console.warn(`no ${language} text for:`, text);
  if (!values) return translated ?? text;
  let format = formats.get(text);
  if (!format) {
    format = new IntlMessageFormat(translated ?? text, locale, undefined, { ignoreTag: true });
    formats.set(text, format);
  }
  return String(format.format(values));
}

/** A number with a decimal sign of the language. */
const POINT = (1.5).toLocaleString(locale).slice(1, 2);
export const decimal = (value: number, digits: number): string => value.toFixed(digits).replace(".", POINT);

/** A number with this number of significant digits. */
export const significant = (value: number, digits: number): string =>
  value.toPrecision(digits).replace(".", POINT);

/** A count with separated thousands. */
export const count = (value: number): string => value.toLocaleString(locale);

// Words of the service: states, phases, orders, outcomes. Other words are shown as they are.
const WORDS: Record<string, string> = {
  "accept": t("accept"),
  "acknowledged": t("acknowledged"),
  "anticlockwise": t("anticlockwise"),
  "approach": t("approach"),
  "armed": t("armed"),
  "burned": t("burned"),
  "burning": t("burning"),
  "cancelled": t("cancelled"),
  "clockwise": t("clockwise"),
  "complete": t("complete"),
  "copter": t("copter"),
  "disarmed": t("disarmed"),
  "done": t("done"),
  "final": t("final"),
  "flies home": t("flies home"),
  "go-around": t("go-around"),
  "going around": t("going around"),
  "hold": t("hold"),
  "land": t("land"),
  "lost": t("lost"),
  "never heard": t("not connected"),
  "not reached": t("not reached"),
  "on its way": t("on its way"),
  "on task": t("on task"),
  "on the ground": t("on the ground"),
  "online": t("online"),
  "ordered": t("ordered"),
  "out": t("out"),
  "plane": t("plane"),
  "refuse": t("refuse"),
  "refused": t("refused"),
  "renew": t("renew"),
  "resume": t("resume"),
  "return": t("return"),
  "sending": t("sending"),
  "start": t("start"),
  "unburned": t("unburned"),
  "unknown": t("unknown"),
  "waiting": t("waiting"),
};

/** A word of the service in the chosen language. */
export const word = (name: string): string => WORDS[name] ?? name;

/** Set the language of the document, and translate the labels that its HTML contains. */
export function translateDocument(): void {
  document.documentElement.lang = language;
  for (const element of document.querySelectorAll("[aria-label]")) {
    element.setAttribute("aria-label", t(element.getAttribute("aria-label")!));
  }
}
