// The page for annotations: connects its parts, and sends requests to the server.

import { showIdentity } from "/identity.js";
import { directionsOf } from "/orbit.js";
import { offerOthers } from "/series.js";
import { Refusal, request } from "/view.js";
import { Annotations, Conflict, archivesForResults, newId } from "./api.js";
import { askAuthor, askConflict, askDetails, askExport, askSet, showHelp } from "./dialogs.js";
import { Guide } from "./guide.js";
import { Hand } from "./hand.js";
import { Job } from "./job.js";
import { onKeys } from "./keys.js";
import { List } from "./list.js";
import { Live } from "./live.js";
import { Log } from "./log.js";
import { Model } from "./model.js";
import { Files } from "./files.js";
import { onSettings, pageFacts } from "./settings.js";
import { SlicePane } from "./slice-pane.js";
import { Structures } from "./structures.js";
import { Tools } from "./tools.js";
import { VolumePane } from "./volume-pane.js";

const $ = (id) => document.getElementById(id);
const model = new Model();
let annotations = null;
let live = null;
let isOn = false;
/** The name that the server has verified; null on an open server. */
let verified = null;

// ---------------------------------------------------------------- messages

let noticeTimer = 0;
let briefTimer = 0;

/** Displays a message: above the panes, or in the status line if it is brief. */
function say(text, { brief = false, error = false, stays = false } = {}) {
  if (brief) {
    $("brief").textContent = text;
    clearTimeout(briefTimer);
    briefTimer = setTimeout(() => ($("brief").textContent = ""), 6000);
    return;
  }
  $("notice").textContent = text;
  $("notice").classList.toggle("error", error);
  $("notice").hidden = false;
  clearTimeout(noticeTimer);
  if (!stays) noticeTimer = setTimeout(() => ($("notice").hidden = true), error ? 12_000 : 6000);
}

/** Displays an error; null clears it. */
function fail(error) {
  if (!error) return;
  if (error.kind === "nothing-to-undo") return say("There is nothing of yours to take back, or to make again.", { brief: true });
  const known = error instanceof Refusal;
  say(known ? error.message : `That did not work: ${error.message}`, { error: true });
  if (!known) console.error(error);
}

// ---------------------------------------------------------------- changes

/** Returns the author's name; the user enters it once. */
async function named() {
  if (model.author) return true;
  const name = await askAuthor("");
  if (name) model.setAuthor(name);
  else say("Nothing was changed: changes are kept with the name of who makes them.");
  return Boolean(name);
}

/** Applies all changes or none; returns the events, or null if nothing changed. */
async function commit(changes, reason = "") {
  if (!isOn) {
    say($("off").hidden ? "The annotations are not loaded: nothing can be kept now." : "Annotations are off on this server: nothing can be kept.");
    return null;
  }
  if (!(await named())) return null;
  try {
    return await took(await annotations.apply(changes, reason));
  } catch (error) {
    if (!(error instanceof Conflict)) return fail(error), null;
    return settle(error, changes, reason);
  }
}

/** Displays both versions of a conflict; the user decides. */
async function settle({ current }, changes, reason) {
  const change = changes.find(({ item, id }) => (item?.id ?? id) === current?.item.id) ?? changes[0];
  await reload();
  if (change.change === "delete") {
    say(current ? `“${current.item.name}” was changed by another user in the meantime and was not deleted. Check it, and delete it again.` : "It was deleted already.");
    return null;
  }
  const answer = await askConflict(current, change.item);
  if (answer === "mine") return commit([{ ...change, version: current.version }], reason);
  if (answer === "both") {
    const name = current ? `${change.item.name} (${model.author})`.slice(0, 120) : change.item.name;
    return commit([{ change: "create", item: { ...change.item, id: newId(), name } }], reason);
  }
  return null;
}

/** Applies the events of own changes; reloads the list if other events are missing. */
async function took(events) {
  if (!model.follow(events)) await reload(true);
  return events;
}

function change({ item, version }, parts, reason = "") {
  if (item.locked && !("locked" in parts)) {
    say(`“${item.name}” is locked. Press K to unlock it.`);
    return Promise.resolve(null);
  }
  return commit([{ change: "update", item: { ...item, ...parts }, version }], reason);
}

async function details(entry) {
  const found = await askDetails(entry.item);
  if (!found) return;
  if (found.isCodeCut) say("A coded concept needs code, scheme and meaning: it was left out.");
  await change(entry, found.changed, "described");
}

function remove({ item, version }) {
  if (item.locked) return say(`“${item.name}” is locked. Press K to unlock it.`);
  return commit([{ change: "delete", id: item.id, version }], "deleted").then((events) => {
    if (events) say(`“${item.name}” is deleted. Ctrl+Z brings it back.`, { brief: true });
  });
}

async function back(what) {
  if (!isOn || !(await named())) return;
  try {
    const events = await took(await annotations[what]());
    const names = [...new Set(events.map(({ item, id }) => item?.name ?? model.entry(id)?.item.name ?? "an item"))];
    say(`${what === "undo" ? "Taken back" : "Made again"}: ${names.slice(0, 3).join(", ")}${names.length > 3 ? ` and ${names.length - 3} more` : ""}`, { brief: true });
  } catch (error) {
    if (!(error instanceof Conflict)) return fail(error);
    await reload();
    say("This cannot be undone: another user has changed the same item since.", { error: true });
  }
}

/** Loads all items; returns "there", "off" without annotations on the server, "missing" without the volume, or "away". */
async function reload(whole = false) {
  if (whole) annotations.tag = null;
  try {
    const found = await annotations.list();
    // A response may be older than the latest local change.
    if (found && found.seq >= model.seq) model.take(found);
    else if (found) annotations.tag = null;
    setOn(true);
    return "there";
  } catch (error) {
    if (error.kind === "annotations-off") return setOn(false), "off";
    // A server that has just started loads its series first.
    if (error.kind === "no-such-volume") return "missing";
    if (!(error instanceof Refusal)) fail(error);
    return "away";
  }
}

function setOn(on) {
  isOn = on;
  $("off").hidden = on;
  document.body.dataset.annotations = on ? "on" : "off";
  for (const id of ["undo", "redo", "log-button", "import-button", "export-button", "templates-button"]) $(id).disabled = !on;
}

// ---------------------------------------------------------------- parts

const parts = { annotations: () => annotations, commit, change, remove, details, took, say, fail };
const hand = new Hand(model, parts);
const job = new Job($("job"));
const panesHost = $("panes");
const paneParts = { model, hand, fail };
const panes = [
  new VolumePane(panesHost, paneParts),
  ...["axial", "sagittal", "coronal", "oblique"].map((name) => new SlicePane(panesHost, name, paneParts)),
];
const redraw = () => panes.forEach((pane) => pane.draw());
hand.structures = new Structures(model, { ...parts, job, spot: (...where) => hand.spot(...where), redraw });
new Tools(model, { finish: () => hand.placing.finish().catch(fail), removePoint: () => hand.removePoint() });
const guide = new Guide($("guide"), model, parts);
hand.structures.advance = () => guide.advance();
const list = new List($("items"), model, {
  ...parts, mesh: (entry) => hand.structures.mesh(entry), fill: (entries) => hand.structures.fill(entries),
});
const log = new Log($("log"), $("log-button"), model, parts);
const files = new Files($("import"), model, { ...parts, named, isOn: () => isOn });

const page = {
  model, panes, hand, job, list, guide, log, change, remove, details, fail,
  undo: () => back("undo"),
  redo: () => back("redo"),
  chooseFiles: () => files.choose(),
  export: () => exportAs(),
  help: showHelp,
};
onKeys(page);

let isExporting = false;

async function exportAs() {
  if (isExporting) return; // a second click, before the dialog is there
  isExporting = true;
  await exportChoice().finally(() => { isExporting = false; });
}

async function exportChoice() {
  const sets = [...new Set([...model.items.values()].map(({ item }) => item.set))].sort();
  const archives = await archivesForResults().catch(fail);
  const choice = archives && (await askExport(sets, model.set, archives));
  if (choice) await files.save(choice);
}

// Placing continues with the next entry of the template.
const commitAlong = hand.placing.commit;
hand.placing.commit = async (change, spot) => {
  const along = model.guide !== null && change.change === "update";
  await commitAlong(change, spot);
  if (along && model.entry(change.item.id)?.item.state === "defined") guide.advance();
};

// ---------------------------------------------------------------- effects of changes

const isMoving = () => document.querySelector(".pane.turning") !== null || panes.some((pane) => pane.cine?.playing);
model.on("cursor window", () => panes.slice(1).forEach((pane) => pane.refresh(isMoving())));
model.on("pose", () => {
  panes[0].refresh(isMoving());
  if (model.oblique.follows) {
    const { toEye: normal, up } = directionsOf(model.pose);
    Object.assign(model.oblique, { normal, up });
    panes[4].refresh(isMoving());
  }
});
model.on("cursor items selection draft sets pose tool", redraw);
model.on("cursor", () => pageFacts.readout(model));
model.on("author", () => {
  pageFacts.author(model);
  if (annotations) annotations.author = model.author;
  if (annotations) reload(true);
});
model.on("sets items", () => pageFacts.sets(model));

$("undo").addEventListener("click", page.undo);
$("redo").addEventListener("click", page.redo);
$("log-button").addEventListener("click", () => log.toggle());
$("import-button").addEventListener("click", page.chooseFiles);
$("export-button").addEventListener("click", page.export);
$("help-button").addEventListener("click", page.help);
$("templates-button").addEventListener("click", async () => (await named()) && guide.open());
$("author").addEventListener("click", async () => {
  if (verified) return say(`You are signed in as ${verified}; that name is recorded with every change.`);
  const name = await askAuthor(model.author);
  if (name) model.setAuthor(name);
});
$("set").addEventListener("change", async ({ target }) => {
  if (target.value) return model.chooseSet(target.value);
  const made = (await named()) ? await askSet(model.author) : null;
  if (made) {
    await annotations.putSet(made).then(() => reload(true), fail);
    model.chooseSet(made.name);
  }
  pageFacts.sets(model);
});

// ---------------------------------------------------------------- start

async function show(volume) {
  live?.end();
  panes.forEach((pane) => pane.cine?.stop());
  model.volume = volume;
  Object.assign(model, { crop: null, planes: [] });
  model.items = new Map();
  model.seq = 0;
  annotations = new Annotations(volume, model.author);
  pageFacts.volume(volume);
  pageFacts.look(model);
  model.moveCursor(volume.center_mm);
  hand.look(volume.center_mm);
  model.changed("items", "pose");
  panes.forEach((pane) => pane.refresh());
  await reload(true);
  const words = {
    live: "live", asking: "up to date", away: "the server does not answer", off: "annotations are off",
    missing: "the server does not have this series now",
  };
  live = new Live(volume, model.author, {
    news: (seq) => (seq !== undefined && seq <= model.seq ? "there" : reload()),
    changed: (state) => {
      $("live").textContent = words[state];
      $("live").dataset.state = state;
    },
  });
}

async function start() {
  const identity = await showIdentity($("identity"));
  verified = identity.name;
  if (verified) model.setAuthor(verified);
  await onSettings(model, panes);
  pageFacts.author(model);
  for (;;) {
    const { volumes, loading } = await (await request("/v1/volumes")).json();
    const linked = new URLSearchParams(location.hash.slice(1)).get("volume");
    const volume = linked === null ? volumes[0] : volumes.find(({ id }) => id === linked);
    if (volume) return choose(volumes, volume);
    if (!loading && linked === null) return say("No volume is loaded. Start the server with --series, or add one on the page at /, and come back.", { error: true, stays: true });
    if (loading) say("Loading the series …");
    else offerOthers($("missing"), volumes, (chosen) => choose(volumes, chosen).catch(fail));
    await new Promise((resolve) => setTimeout(resolve, loading ? 700 : 2000));
    if (model.volume) return; // another one was chosen
  }
}

function choose(volumes, volume) {
  const isBusy = () => panes.some((pane) => pane.fetcher.isBusy);
  pageFacts.volumes(volumes, (chosen) => show(chosen).catch(fail), isBusy);
  $("missing").hidden = true;
  return show(volume);
}

// Another link in the same window.
addEventListener("hashchange", () => location.reload());

start().catch(fail);
