// Photos of notes: sent before their note, and shown in a dialog.

import { ask, errorText } from "./api.ts";
import { showMessage } from "./actions.ts";
import { byId, fill, h } from "./dom.ts";
import { t } from "./messages.ts";
import type { LogRecord } from "./types.ts";

export const PHOTO_TYPES = "image/jpeg,image/png,image/webp";
const MAX_BYTES = 10 * 1024 * 1024; // the limit of the service

/** Send a photo; return its name for the note. Throws an error with the reason. */
export async function sentPhoto(file: File): Promise<string> {
  if (file.size > MAX_BYTES) throw new Error(t("the photo has more than 10 MB"));
  const answer = await ask("photos", { method: "POST", body: file, headers: { "Content-Type": "application/octet-stream" } });
  return ((await answer.json()) as { photo: string }).photo;
}

/** The line of a note without the name of its photo. */
export const withoutName = ({ text, photo }: LogRecord): string => (photo ? text.replace(` (photo ${photo})`, "") : text);

/** Show the photo of a note, with the text of the note. */
export async function showPhoto(note: LogRecord): Promise<void> {
  const dialog = byId("photo") as HTMLDialogElement;
  let address = "";
  try {
    address = URL.createObjectURL(await (await ask(`photos/${note.photo}`)).blob());
  } catch (error) {
    return showMessage(t("No photo: {reason}", { reason: errorText(error) }), true);
  }
  const close = h("button", { type: "button", class: "primary", onclick: () => dialog.close() }, t("Close"));
  dialog.onclose = () => URL.revokeObjectURL(address);
  dialog.close();
  fill(
    dialog,
    h("div", { class: "row head" }, h("h2", {}, note.note), close),
    h("img", { src: address, alt: t("Photo of the note: {note}", { note: note.note }) }),
    h("p", {}, withoutName(note)),
  );
  dialog.show(); // not modal: the abort button remains accessible
  close.focus();
}
