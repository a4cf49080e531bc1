// Messages over the picture: events, and errors with their remedies.

import { $ } from "./state.js";
import { Refusal } from "./view.js";

const SHOWN_MS = 5000;

export function notify(text, isError = false) {
  const notice = $("notice");
  notice.textContent = text;
  notice.classList.toggle("error", isError);
  notice.hidden = false;
  if (!isError) setTimeout(() => (notice.hidden ||= notice.textContent === text), SHOWN_MS);
}

/** Displays an error; null clears it. */
export function showFailure(error) {
  if (error) return notify(error instanceof Refusal ? error.message : `The picture cannot be shown: ${error.message}`, true);
  if ($("notice").classList.contains("error")) $("notice").hidden = true;
}
