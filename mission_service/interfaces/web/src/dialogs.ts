// Dialogs: the token, the confirmation of an order, and the list of keys.

import { byId, fill, h } from "./dom.ts";
import { allShortcuts } from "./keys.ts";
import { t } from "./messages.ts";
import { PHOTO_TYPES } from "./photos.ts";
import { keepToken } from "./token.ts";

/** Close the list of keys, the display settings, a photo and the tour; return whether one was open. */
export function closeHelp(): boolean {
  const open = ["help", "display", "photo", "tour"].map((id) => byId(id) as HTMLDialogElement).filter((dialog) => dialog.open);
  for (const dialog of open) dialog.close();
  return open.length > 0;
}

/** Show the dialog for the token; call `entered` after its input. */
export function askForToken(reason: string, entered: () => void): void {
  const login = byId("login") as HTMLDialogElement;
  if (login.open) return;
  const field = h("input", { type: "password", id: "token", autocomplete: "off", required: true });
  const form = h(
    "form",
    { method: "dialog" },
    h("h2", {}, t("Token")),
    h("p", {}, reason),
    h("label", { for: "token" }, t("Token from the output of the service, or from its operator")),
    field,
    h("button", { class: "primary" }, t("Open the map")),
  );
  form.addEventListener("submit", () => {
    keepToken(field.value);
    entered();
  });
  fill(login, form);
  login.oncancel = (event) => event.preventDefault();
  login.showModal();
}

let unanswered: (yes: boolean) => void = () => undefined;

/** Show a question; return whether the answer is yes. A question that is still open is answered with no. */
export function confirmed(text: string): Promise<boolean> {
  const question = byId("question") as HTMLDialogElement;
  unanswered(false);
  return new Promise((answer) => {
    const end = (yes: boolean): void => {
      unanswered = () => undefined;
      question.close();
      answer(yes);
    };
    unanswered = end;
    const no = h("button", { type: "button", onclick: () => end(false) }, t("No"));
    const yes = h("button", { type: "button", class: "primary", onclick: () => end(true) }, t("Yes, do it"));
    fill(question, h("p", {}, text), h("div", { class: "row" }, no, yes));
    question.onkeydown = (event) => {
      if (event.key === "Escape") end(false);
    };
    question.show(); // not modal: the abort button remains accessible
    no.focus();
  });
}

/** Ask for a line of text and a photo; return them, or null if the question is closed without a text. */
export function entered(label: string): Promise<{ text: string; photo: File | undefined } | null> {
  const question = byId("question") as HTMLDialogElement;
  const MAX_LENGTH = 200; // the limit of the service
  unanswered(false);
  return new Promise((answer) => {
    const end = (yes: boolean): void => {
      unanswered = () => undefined;
      question.close();
      const text = field.value.trim();
      answer(yes && text ? { text, photo: photo.files?.[0] } : null);
    };
    unanswered = end;
    const field = h("input", { type: "text", id: "entered", maxlength: MAX_LENGTH, autocomplete: "off", required: true });
    const photo = h("input", { type: "file", id: "note-photo", accept: PHOTO_TYPES });
    const cancel = h("button", { type: "button", onclick: () => end(false) }, t("Cancel"));
    const form = h("form", { method: "dialog" }, h("label", { for: "entered" }, label), field,
      h("label", { for: "note-photo" }, t("Photo, from the camera or a file (not required)")), photo,
      h("div", { class: "row" }, cancel, h("button", { class: "primary" }, t("Add"))));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      end(true);
    });
    question.onkeydown = (event) => {
      if (event.key === "Escape") end(false);
    };
    fill(question, form);
    question.show(); // not modal: the abort button remains accessible
    field.focus();
  });
}

const BUILT_IN: [string, string][] = [
  [t("Tab, Shift+Tab"), t("Next or previous control")],
  [t("Arrow keys, + and −"), t("Move and zoom the map while it has the focus")],
  [t("Space, Enter, Escape"), t("With a pen: add a corner at the cross, end the stroke, cancel the stroke")],
];

export function showHelp(): void {
  const help = byId("help") as HTMLDialogElement;
  if (closeHelp()) return;
  const rows = [...allShortcuts().map(({ keys, does }): [string, string] => [keys, does]), ...BUILT_IN];
  const close = h("button", { type: "button", class: "primary", onclick: () => help.close() }, t("Close"));
  fill(
    help,
    h("div", { class: "row" }, h("h2", {}, t("Keys")), close),
    h(
      "table",
      {},
      ...rows.map(([keys, does]) => h("tr", {}, h("th", { scope: "row" }, h("kbd", {}, keys)), h("td", {}, does))),
    ),
  );
  help.show(); // not modal: the abort button remains accessible
  close.focus();
}
