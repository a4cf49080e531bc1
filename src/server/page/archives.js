// The search over DICOM archives: its form, the series that match, and loading them with progress; and a button for each
// archive that takes pictures.

import { notify, showFailure } from "./notice.js";
import { DOT, $ } from "./state.js";
import { request } from "./view.js";

const FIELDS = ["patient_id", "patient_name", "accession_number", "study_date", "description"];

/** How often the state of a loading series is requested, ms. */
const POLL_MS = 300;

/**
 * Shows the search where the server has archives, and a button for each archive that takes pictures. `loaded` is called
 * with the id of a volume that was loaded on demand; `picture` returns the address of the shown picture.
 */
export async function showArchives({ loaded, picture }) {
  const { archives, take_results: takeResults } = await (await request("/v1/archives")).json();
  if (!archives.length) return;
  $("sending").hidden = !takeResults;
  if (takeResults) $("sending").replaceChildren(...archives.map((name) => sendingButton(name, picture)));
  $("archives").hidden = false;
  $("archive-name").replaceChildren(...archives.map((name) => new Option(name)));
  $("archive-field").hidden = archives.length === 1;
  $("archive-search").addEventListener("click", () => search(loaded));
  $("archives").addEventListener("keydown", ({ key, target }) => {
    if (key === "Enter" && target.type === "search") search(loaded);
  });
}

function sendingButton(archive, picture) {
  const button = Object.assign(document.createElement("button"), { type: "button" });
  const to = Object.assign(document.createElement("small"), { textContent: `to ${archive}` });
  button.append("Store picture ", to);
  button.addEventListener("click", async () => {
    const address = picture();
    if (!address) return;
    button.disabled = true;
    try {
      const { outcome } = await (await post(address, { archive })).json();
      notify(outcome === "stored" ? `Stored in ${archive}.` : `${archive} has this picture already.`);
    } catch (error) {
      showFailure(error);
    }
    button.disabled = false;
  });
  return button;
}

async function search(loaded) {
  const given = FIELDS.map((name) => [name, $(`archive-${name}`).value.trim()]).filter(([, value]) => value);
  const list = $("archive-series");
  list.replaceChildren();
  if (!given.length) return say("Fill in at least one field.");
  say("Searching …");
  $("archive-search").disabled = true;
  const archive = $("archive-name").value;
  try {
    const answer = await post(`/v1/archives/${archive}/search`, Object.fromEntries(given));
    const { series, has_more: hasMore } = await answer.json();
    say(foundWords(series.length, hasMore));
    list.replaceChildren(...series.map((one) => row(archive, one, loaded)));
  } catch (error) {
    say(error.message, true);
  }
  $("archive-search").disabled = false;
}

function foundWords(count, hasMore) {
  if (hasMore) return `The first ${count} CT series that match. Narrow the search to see others.`;
  return count ? `${count} CT series` : "No CT series match.";
}

function post(path, body) {
  return request(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
}

function say(text, isError = false) {
  $("archive-found").textContent = text;
  $("archive-found").classList.toggle("error", isError);
}

/** 20061012 as 2006-10-12. */
function dateWords(date) {
  return date.replace(/^(\d{4})(\d{2})(\d{2})$/, "$1-$2-$3");
}

function row(archive, series, loaded) {
  const item = document.createElement("li");
  const facts = [dateWords(series.study_date), series.body_part, series.instances === null ? "" : `${series.instances} slices`];
  const what = Object.assign(document.createElement("span"), { textContent: facts.filter(Boolean).join(DOT) || "CT series" });
  const who = [series.description, series.patient_name?.replaceAll("^", " "), series.patient_id];
  const more = Object.assign(document.createElement("small"), { textContent: who.filter(Boolean).join(DOT) });
  const button = Object.assign(document.createElement("button"), { type: "button", textContent: "Load" });
  const bar = Object.assign(document.createElement("progress"), { hidden: true });
  bar.setAttribute("aria-label", "Loading the series");
  const state = document.createElement("output");
  item.append(what, button, more, bar, state);
  const path = `/v1/archives/${archive}/series/${series.key}`;
  button.addEventListener("click", async () => {
    button.disabled = true;
    try {
      loaded(await volumeOf(await (await post(path, {})).json(), path, { bar, state }));
    } catch (error) {
      Object.assign(state, { textContent: error.message, className: "error" });
    }
    bar.hidden = true;
    button.disabled = false;
  });
  return item;
}

/** Waits until a series is loaded, with progress; returns the id of its volume. */
async function volumeOf(first, path, { bar, state }) {
  bar.hidden = false;
  state.className = "";
  for (let load = first; ; load = await (await request(path)).json()) {
    if (load.state === "failed") throw new Error(load.reason);
    if (load.state === "ready") {
      state.textContent = "";
      return load.volume;
    }
    if (load.state === "retrieving") Object.assign(bar, { max: load.files, value: load.done });
    else bar.removeAttribute("value");
    state.textContent = words(load);
    await new Promise((resolve) => setTimeout(resolve, POLL_MS));
  }
}

function words({ state, done, files }) {
  if (state === "retrieving") return `${done} of ${files} slices`;
  return state === "reading" ? "reading the slices …" : "waiting for other series …";
}
