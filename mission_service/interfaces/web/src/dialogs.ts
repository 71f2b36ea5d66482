// Dialogs: the token, the confirmation of an order, and the list of keys.

import { byId, fill, h } from "./dom.ts";
import { allShortcuts } from "./keys.ts";
import { keepToken } from "./token.ts";

/** Close the list of keys and the display settings; return whether one was open. */
export function closeHelp(): boolean {
  const open = ["help", "display"].map((id) => byId(id) as HTMLDialogElement).filter((dialog) => dialog.open);
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
    h("h2", {}, "Token"),
    h("p", {}, reason),
    h("label", { for: "token" }, "Token from the output of the service, or from its operator"),
    field,
    h("button", { class: "primary" }, "Open the map"),
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
    const no = h("button", { type: "button", onclick: () => end(false) }, "No");
    const yes = h("button", { type: "button", class: "primary", onclick: () => end(true) }, "Yes, do it");
    fill(question, h("p", {}, text), h("div", { class: "row" }, no, yes));
    question.onkeydown = (event) => {
      if (event.key === "Escape") end(false);
    };
    question.show(); // not modal: the abort button remains accessible
    no.focus();
  });
}

/** Ask for a line of text; return it, or "" if the question is closed without one. */
export function entered(label: string): Promise<string> {
  const question = byId("question") as HTMLDialogElement;
  const MAX_LENGTH = 200; // the limit of the service
  unanswered(false);
  return new Promise((answer) => {
    const end = (yes: boolean): void => {
      unanswered = () => undefined;
      question.close();
      answer(yes ? field.value.trim() : "");
    };
    unanswered = end;
    const field = h("input", { type: "text", id: "entered", maxlength: MAX_LENGTH, autocomplete: "off", required: true });
    const cancel = h("button", { type: "button", onclick: () => end(false) }, "Cancel");
    const form = h("form", { method: "dialog" }, h("label", { for: "entered" }, label), field,
      h("div", { class: "row" }, cancel, h("button", { class: "primary" }, "Add")));
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
  ["Tab, Shift+Tab", "Next or previous control"],
  ["Arrow keys, + and −", "Move and zoom the map while it has the focus"],
  ["Space, Enter, Escape", "With a pen: add a corner at the cross, end the stroke, cancel the stroke"],
];

export function showHelp(): void {
  const help = byId("help") as HTMLDialogElement;
  if (closeHelp()) return;
  const rows = [...allShortcuts().map(({ keys, does }): [string, string] => [keys, does]), ...BUILT_IN];
  const close = h("button", { type: "button", class: "primary", onclick: () => help.close() }, "Close");
  fill(
    help,
    h("div", { class: "row" }, h("h2", {}, "Keys"), close),
    h(
      "table",
      {},
      ...rows.map(([keys, does]) => h("tr", {}, h("th", { scope: "row" }, h("kbd", {}, keys)), h("td", {}, does))),
    ),
  );
  help.show(); // not modal: the abort button remains accessible
  close.focus();
}
