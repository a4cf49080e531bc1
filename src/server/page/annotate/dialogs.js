// Dialogs: author, conflict, new set, export, templates, help. All use one `<dialog>`.

import { FORMATS } from "./formats.js";
import { element } from "./pane.js";
import { measureWords, measures, places, pointsOf } from "./geometry.js";
import { colorOf } from "./model.js";

const dialog = () => document.getElementById("dialog");

// Settles when the last dialog has closed.
let closed = Promise.resolve();

/**
 * Opens a dialog and returns the value of the button that closed it and the fields of the form; null after Escape. A dialog
 * that is open, such as one about another conflict, closes first.
 *
 * Only the primary button submits the form.
 */
function ask(...content) {
  const answer = closed.then(() => shown(...content));
  closed = answer.then(() => {}, () => {});
  return answer;
}

function shown(title, content, buttons, wide = false) {
  const box = dialog();
  box.classList.toggle("wide", wide);
  const row = buttons.map(([value, words, primary]) => (primary
    ? element("button", { value, className: "primary", type: "submit" }, words)
    : element("button", { type: "button", value, onclick: () => box.close(value) }, words)));
  const form = element("form", { method: "dialog" }, element("h2", { id: "dialog-title" }, title), ...content, element("p", { className: "dialog-buttons" }, ...row));
  // Enter confirms in every field, also in a menu, which it would open otherwise.
  form.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || event.isComposing || event.target.closest("button, textarea")) return;
    event.preventDefault();
    form.requestSubmit(form.querySelector(".primary"));
  });
  box.replaceChildren(form);
  box.returnValue = "";
  box.showModal();
  if (!form.querySelector("input, select, textarea")) form.querySelector(".primary")?.focus();
  // The focused button may be at the end: scroll to the beginning.
  box.scrollTop = 0;
  return new Promise((resolve) => {
    box.addEventListener("close", () => {
      const fields = Object.fromEntries(new FormData(form));
      for (const check of form.querySelectorAll("input[type=checkbox]")) fields[check.name] = check.checked;
      resolve(box.returnValue ? { button: box.returnValue, ...fields } : null);
    }, { once: true });
  });
}

const paragraph = (text, className = "hint") => element("p", { className }, text);

function field(label, input) {
  input.id = `dialog-${input.name}`;
  return element("div", { className: "field" }, element("label", { htmlFor: input.id }, label), input);
}

const textField = (name, value, more = {}) => element("input", { name, value, type: "text", maxLength: 120, required: true, autocomplete: "off", ...more });

/** The name of the author; null if the user enters none. */
export async function askAuthor(now) {
  const found = await ask("Who are you?", [
    paragraph("Your name is kept with every change that you make, and in this browser."),
    field("Name", textField("name", now)),
  ], [["", "Cancel"], ["ok", "Keep", true]]);
  return found?.name.trim() || null;
}

/** Name, description and list of an item; null if the user changes nothing. */
export async function askDetails(item) {
  const { concept } = item;
  const about = [
    `By ${item.author}, ${new Date(item.created).toLocaleString()}`,
    ...measures(item.geometry).map((measure) => `${measure.name} ${measureWords(measure)}`),
    ...pointsOf(item.geometry).slice(0, 4).map((mm) => `LPS ${mm.map((value) => value.toFixed(2)).join(", ")} mm`),
    ...(item.placement?.snapped_mm ? [`snapped by ${Math.hypot(...item.placement.snapped_mm).toFixed(2)} mm`] : []),
  ];
  const description = element("textarea", { name: "description", value: item.description ?? "", maxLength: 10_000, rows: 3 });
  const found = await ask("Details", [
    field("Name", textField("name", item.name)),
    field("Description", description),
    field("List", textField("list", item.list ?? "", { required: false })),
    element("fieldset", { className: "coded" }, element("legend", {}, "Coded concept, such as T-11180, SRT, Mandible"),
      textField("code", concept?.code ?? "", { required: false, maxLength: 16, placeholder: "code", ariaLabel: "Code" }),
      textField("scheme", concept?.scheme ?? "", { required: false, maxLength: 16, placeholder: "scheme", ariaLabel: "Scheme" }),
      textField("meaning", concept?.meaning ?? "", { required: false, maxLength: 64, placeholder: "meaning", ariaLabel: "Meaning" })),
    ...about.map((text) => paragraph(text)),
  ], [["", "Cancel"], ["ok", "Keep", true]]);
  if (!found) return null;
  const coded = ["code", "scheme", "meaning"].map((key) => found[key].trim());
  const whole = coded.every(Boolean) ? { code: coded[0], scheme: coded[1], meaning: coded[2] } : undefined;
  const changed = { name: found.name.trim() || item.name, description: found.description, list: found.list.trim(), concept: whole };
  return { changed, isCodeCut: coded.some(Boolean) && !whole };
}

export async function askSet(author) {
  const found = await ask("A new set", [
    paragraph("A set has the items of one reader, or of one purpose."),
    field("Name: letters, digits, - _ and .", textField("name", "", { pattern: "[A-Za-z0-9._\\-]+", maxLength: 64 })),
    field("Reader (nobody: anybody's)", textField("reader", author, { required: false })),
    element("label", { className: "check" }, element("input", { type: "checkbox", name: "blinded" }), "Blinded: only its reader sees it, and its reader sees no other set"),
  ], [["", "Cancel"], ["ok", "Make", true]]);
  if (!found?.name) return null;
  return { name: found.name, ...(found.reader.trim() ? { reader: found.reader.trim() } : {}), blinded: found.blinded };
}

/**
 * The export to make: `{ format, set, to }`; an empty set means all sets, and `to` is the name of an archive, or empty
 * for a file.
 */
export async function askExport(sets, now, archives) {
  const formats = FORMATS.filter(({ isWritten }) => isWritten).map(({ name: value, title }, i) => element(
    "label", { className: "choice" },
    element("input", { type: "radio", name: "format", value, checked: i === 0 }), element("b", {}, value), element("span", {}, title),
  ));
  const select = element("select", { name: "set" }, new Option("all sets", ""), ...sets.map((name) => new Option(name, name, false, name === now)));
  const to = element("select", { name: "to" }, new Option("a file", ""), ...archives.map((name) => new Option(`${name} (archive)`, name)));
  const found = await ask("Export", [
    field("Items of", select),
    ...(archives.length ? [field("To", to)] : []),
    element("fieldset", { className: "choices" }, element("legend", {}, "Format"), ...formats),
    paragraph("Values that the format cannot hold are left out and counted."),
  ], [["", "Cancel"], ["ok", "Export", true]], true);
  return found && { format: found.format, set: found.set, to: found.to ?? "" };
}

/** Differences between two versions of an item: rows of [property, theirs, mine]. */
function differences(theirs, mine) {
  const words = (item) => ({
    name: item.name, description: item.description ?? "", set: item.set, list: item.list ?? "", state: item.state,
    locked: item.locked ? "yes" : "no", shown: item.visible ? "yes" : "no", colour: colorOf(item),
    place: pointsOf(item.geometry).map(places).join("; "),
    measure: measures(item.geometry).map(measureWords).join(", "),
  });
  const [left, right] = [words(theirs), words(mine)];
  return Object.keys(left).filter((key) => left[key] !== right[key]).map((key) => [key, left[key], right[key]]);
}

/**
 * Shows both versions of an item that two people changed. Returns `mine`, `theirs` or `both`; null leaves theirs and
 * postpones the decision.
 */
export async function askConflict(current, mine) {
  if (!current) {
    const found = await ask("Deleted by someone else", [
      paragraph(`Someone else deleted “${mine.name}” while you were changing it.`, ""),
    ], [["theirs", "Leave it deleted"], ["both", "Make it again", true]]);
    return found?.button ?? null;
  }
  const rows = differences(current.item, mine).map(([what, theirs, own]) =>
    element("tr", {}, element("th", { scope: "row" }, what), element("td", {}, theirs || "–"), element("td", {}, own || "–")));
  const head = element("tr", {}, element("th"), element("th", { scope: "col" }, "There now"), element("th", { scope: "col" }, "Yours"));
  const found = await ask("Two people changed this", [
    paragraph(`“${current.item.name}” was changed by someone else (version ${current.version}) while you were changing it. Choose which version to keep.`, ""),
    element("table", { className: "versions" }, element("thead", {}, head), element("tbody", {}, ...rows)),
  ], [["theirs", "Keep theirs"], ["both", "Keep both"], ["mine", "Use mine", true]]);
  return found?.button ?? null;
}

/** How to import items that exist already and differ: query parameters of the import; null cancels it. */
export async function askImport(file, count) {
  const differ = count === 1 ? "One item of this file is here already and differs." : `${count} items of this file are here already and differ.`;
  const found = await ask(`Import ${file}`, [
    paragraph(`${differ} Update them from the file, bring in copies of the file's items, or skip those that differ. An update can be undone.`),
  ], [["", "Cancel"], ["skip", "Skip"], ["duplicate", "Bring in copies"], ["update", "Update", true]]);
  if (!found) return null;
  return found.button === "skip" ? {} : { [found.button]: true };
}

/** The template to follow: `{ name }` of a known one, `{ list: "set\nlist" }` of one in progress, or `{ file }` to add one. */
export async function askTemplate(names, running) {
  const choices = [
    ...running.map(({ set, list, done, total }) => [`list:${set}\n${list}`, list || set, `${done} of ${total} in ${set}: go on`]),
    ...names.map((name) => [`name:${name}`, name, "begin in the chosen set"]),
  ];
  const radios = choices.map(([value, words, about], i) => element(
    "label", { className: "choice" },
    element("input", { type: "radio", name: "which", value, checked: i === 0 }), element("b", {}, words), element("span", {}, about),
  ));
  const none = paragraph("There is no template yet. Bring one as JSON: a name, and its landmarks in order.");
  const found = await ask("Templates", [
    radios.length ? element("fieldset", { className: "choices" }, element("legend", {}, "Landmarks in order"), ...radios) : none,
  ], [["", "Cancel"], ["file", "Bring a file"], ...(radios.length ? [["ok", "Begin", true]] : [])]);
  if (!found) return null;
  if (found.button === "file") return { file: true };
  const [kind, rest] = [found.which.slice(0, 4), found.which.slice(5)];
  return { [kind]: rest };
}

const KEYS = [
  ["Drag, wheel in 3D", "turn, zoom; while a tool is chosen with Alt"],
  ["Right drag", "move the picture"],
  ["Two fingers", "move and zoom, in slices and in 3D"],
  ["Click, drag in a slice", "the cursor goes there, in all views"],
  ["Wheel in a slice", "next slice, with Shift by five; with Ctrl zoom"],
  ["Shift drag", "in a slice: change its window; in 3D: move"],
  ["Press, release", "a tool previews a point, and sets it; with Ctrl without snapping"],
  ["V E", "look; edit by grabbing"],
  ["P L A C O N", "point, line, angle, curve, closed contour, plane"],
  ["R B", "grow a region; paint with a sphere"],
  ["Arrows, Page keys", "move the cursor in the view that has the focus; Shift: by five; Ctrl: the picture"],
  ["Enter", "set a point at the cursor, or the chosen one there; end a curve"],
  ["Escape", "break off what is under way"],
  ["Backspace", "take the last point back; edit: remove the chosen point of a curve"],
  ["Edit, on a curve's line", "add a point there"],
  ["Ctrl+Z, Ctrl+Shift+Z", "undo, redo: your own changes"],
  ["F2 D Delete H K", "rename, details, delete, hide, lock the chosen item"],
  ["[ ]", "item before, after; its points with , and ."],
  ["S", "skip the expected landmark"],
  ["Z; 1 … 5; Home", "enlarge a view; go to it; show it whole"],
  ["G I X ?", "log, import, export, this"],
];

export function showHelp() {
  const rows = KEYS.map(([keys, words]) => element("div", {}, element("dt", {}, keys), element("dd", {}, words)));
  return ask("Keys and mouse", [
    element("dl", {}, ...rows),
    paragraph("Places are DICOM LPS in mm; letters name the patient's sides. This is no medical device."),
  ], [["ok", "Close", true]], true);
}
