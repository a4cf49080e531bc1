// The list of items, by set and list: choose, jump to, rename, recolour, hide, lock, delete,
// measures.

import { element } from "./pane.js";
import { measureWords, measures as measured } from "./geometry.js";
import { colorOf, rgbOf } from "./model.js";

const ICONS = {
  point: '<circle cx="8" cy="8" r="4"/><circle cx="8" cy="8" r=".6"/>',
  line: '<path d="M3.5 12.5l9-9"/><circle cx="3.5" cy="12.5" r="1.4"/><circle cx="12.5" cy="3.5" r="1.4"/>',
  angle: '<path d="M13 12.5H3.5L10 4"/><path d="M8 12.5a4.6 4.6 0 0 0-1.7-3.6"/>',
  curve: '<path d="M2.5 11c3-10 5 6 11-6"/>',
  contour: '<path d="M8 3c4 0 6 2 5.5 5S11 13.500 7 13 2 9.500 3 6.500 5.500 3 8 3z"/>',
  plane: '<path d="M2.500 10.500 6 4h8l-3.500 6.500zM8 7V2.500"/>',
  region: '<path d="M5 4c3-2 7-1 8 2s-1 7-5 7-6-2-6-5 1-3 3-4z" fill="currentColor" fill-opacity=".35"/>',
  mesh: '<path d="M8 2.500 13.500 6v5L8 13.500 2.500 11V6zM8 2.500V8m0 0 5.500-2M8 8 2.500 6M8 8v5.500"/>',
  missing: '<circle cx="8" cy="8" r="4" stroke-dasharray="2 2"/>',
  seen: '<path d="M1.500 8S4 3.500 8 3.500 14.500 8 14.500 8 12 12.500 8 12.500 1.500 8 1.500 8z"/><circle cx="8" cy="8" r="2"/>',
  unseen: '<path d="M1.500 8S4 3.500 8 3.500 14.500 8 14.500 8 12 12.500 8 12.500 1.500 8 1.500 8zM3 13.500l10-11"/>',
  locked: '<rect x="3.500" y="7" width="9" height="6.500" rx="1.200"/><path d="M5.500 7V5a2.500 2.500 0 0 1 5 0v2"/>',
  open: '<rect x="3.500" y="7" width="9" height="6.500" rx="1.200"/><path d="M5.500 7V4.500a2.500 2.500 0 0 1 4.900-.7"/>',
  words: '<path d="M3 4.500h10M3 8h10M3 11.500h6"/>',
  gone: '<path d="M3 4.500h10M6.500 4.500V3h3v1.500M4.500 4.500l.7 9h5.600l.7-9"/>',
  shape: '<path d="M8 2.500 13.500 6v5L8 13.500 2.500 11V6z"/><path d="M8 8v5.500M8 8l5.500-2M8 8 2.500 6"/>',
};

export function icon(name) {
  const box = document.createElement("span");
  box.className = "icon-of";
  box.innerHTML = `<svg viewBox="0 0 16 16" aria-hidden="true">${ICONS[name] ?? ""}</svg>`;
  return box;
}

const iconOf = (item) =>
  item.state !== "defined" ? "missing" : item.geometry?.kind === "curve" && item.geometry.closed ? "contour" : (item.geometry?.kind ?? "missing");

/** Number of rows to draw before the user requests more. */
const MOST_ROWS = 400;

export class List {
  #shut = new Set();
  #renaming = null;

  /** `change` saves an updated item, `remove` deletes one, `mesh` and `fill` make structures. */
  constructor(host, model, { change, remove, details, mesh, fill, say }) {
    Object.assign(this, { host, model, change, remove, details, mesh, fill, say });
    model.on("items sets selection", (changed) => (changed.has("items") || changed.has("sets") ? this.draw() : this.#mark()));
    host.addEventListener("keydown", (event) => this.#key(event));
  }

  draw() {
    if (this.#renaming) return; // when that is done
    const focused = document.activeElement?.closest?.(".item")?.dataset.id;
    const groups = this.model.groups();
    document.getElementById("count").textContent = String(this.model.items.size || "");
    if (!groups.length) {
      this.host.replaceChildren(element("p", { className: "empty" }, "Nothing here yet. Choose the point tool (P) and click on what you see, or drop a file."));
      return;
    }
    let left = MOST_ROWS;
    this.host.replaceChildren(...groups.map((group) => {
      const drawn = this.#group(group, left);
      left = Math.max(0, left - group.entries.length);
      return drawn;
    }));
    this.#mark();
    if (focused) this.host.querySelector(`[data-id="${focused}"] .item-main`)?.focus();
  }

  #group({ set, list, entries }, room) {
    const key = `${set}\n${list}`;
    const known = this.model.sets.find(({ name }) => name === set);
    const dark = this.model.dark.has(set);
    const done = entries.filter(({ item }) => item.state !== "missing").length;
    const contours = entries.filter(({ item }) => item.geometry?.kind === "curve" && item.geometry.closed);
    const title = element("summary", {}, element("b", {}, list || set), element("small", {}, list ? set : (known?.reader ?? "")),
      element("small", { className: "count" }, done < entries.length ? `${done} / ${entries.length}` : String(entries.length)));
    const eye = this.#button(dark ? "unseen" : "seen", dark ? `Show the set ${set}` : `Hide the set ${set}`, () => {
      this.model.dark[dark ? "delete" : "add"](set);
      this.model.changed("items");
    });
    eye.addEventListener("click", (event) => event.preventDefault());
    title.append(...(known?.blinded ? [element("small", { className: "badge" }, "blinded")] : []));
    if (contours.length > 1) title.append(this.#button("region", `Region between these ${contours.length} contours`, () => this.fill(contours), true));
    title.append(eye);
    const rows = entries.slice(0, room).map((entry) => this.#row(entry));
    if (entries.length > rows.length) rows.push(element("p", { className: "empty" }, `and ${entries.length - rows.length} more`));
    const box = element("details", { open: !this.#shut.has(key), className: `item-group${dark ? " dark" : ""}` }, title, element("div", { role: "list" }, ...rows));
    box.addEventListener("toggle", () => this.#shut[box.open ? "delete" : "add"](key));
    return box;
  }

  #button(name, label, press, prevents = false) {
    const made = element("button", { type: "button", className: "mini", title: label, ariaLabel: label, onclick: (event) => {
      if (prevents) event.preventDefault();
      event.stopPropagation();
      press(event);
    } }, icon(name));
    return made;
  }

  #row(entry) {
    const { item, measures = measured(item.geometry) } = entry;
    const color = element("input", { type: "color", value: colorOf(item), ariaLabel: `Colour of ${item.name}`, title: "Colour", disabled: item.locked });
    color.addEventListener("change", () => this.change(entry, { rgb: rgbOf(color.value) }, "recoloured"));
    const measure = measures.map(measureWords).join(" · ");
    const state = item.state === "defined" ? [] : [element("small", { className: `badge ${item.state}` }, item.state)];
    if (item.phase) state.push(element("small", { className: "badge", title: "The phase of the series in which it was placed" }, `phase ${item.phase}`));
    const main = element("button", {
      type: "button", className: "item-main", tabIndex: -1, title: `${item.name}${item.description ? `: ${item.description}` : ""}. Click: jump to it; double click or F2: rename`,
      onclick: () => this.model.jumpTo(item.id),
      ondblclick: () => this.rename(item.id),
    }, icon(iconOf(item)), element("span", { className: "item-name" }, item.name), ...state, element("span", { className: "item-measure" }, measure));
    const row = element("div", { className: "item", role: "listitem" }, color, main,
      this.#button("words", `Details of ${item.name}`, () => this.details(entry)),
      ...(item.geometry?.kind === "region" ? [this.#button("shape", `Mesh of ${item.name}`, () => this.mesh(entry))] : []),
      this.#button(item.visible ? "seen" : "unseen", item.visible ? `Hide ${item.name}` : `Show ${item.name}`, () => this.change(entry, { visible: !item.visible })),
      this.#button(item.locked ? "locked" : "open", item.locked ? `Unlock ${item.name}` : `Lock ${item.name}`, () => this.change(entry, { locked: !item.locked })),
      this.#button("gone", `Delete ${item.name}`, () => this.remove(entry)));
    row.dataset.id = item.id;
    row.dataset.name = item.name;
    row.dataset.state = item.state;
    row.classList.toggle("hidden-item", !item.visible);
    row.classList.toggle("locked-item", item.locked);
    row.setAttribute("aria-label", [item.name, item.state === "defined" ? "" : item.state, measure, item.locked ? "locked" : "", item.visible ? "" : "hidden"].filter(Boolean).join(", "));
    return row;
  }

  #mark() {
    let first = null;
    for (const row of this.host.querySelectorAll(".item")) {
      const chosen = row.dataset.id === this.model.selected;
      first ??= row;
      row.classList.toggle("chosen", chosen);
      const main = row.querySelector(".item-main");
      main?.setAttribute("aria-current", String(chosen));
      if (main) main.tabIndex = chosen ? 0 : -1;
      if (chosen) row.scrollIntoView({ block: "nearest" });
    }
    if (first && !this.host.querySelector(".chosen")) first.querySelector(".item-main")?.setAttribute("tabindex", "0");
  }

  /** Edits the name in its row; Enter saves it, Escape cancels. */
  rename(id) {
    const entry = this.model.entry(id);
    const place = this.host.querySelector(`[data-id="${id}"] .item-main`);
    if (!entry || !place || this.#renaming) return;
    if (entry.item.locked) return this.say(`“${entry.item.name}” is locked. Press K to unlock it.`);
    const input = element("input", { className: "item-rename", value: entry.item.name, maxLength: 120, ariaLabel: "Name" });
    this.#renaming = id;
    place.replaceWith(input);
    input.select();
    const end = (keep) => {
      if (this.#renaming !== id) return;
      this.#renaming = null;
      const name = input.value.trim();
      if (keep && name && name !== entry.item.name) this.change(entry, { name }, "renamed");
      this.draw();
      this.host.querySelector(`[data-id="${id}"] .item-main`)?.focus();
    };
    input.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Enter") end(true);
      if (event.key === "Escape") end(false);
    });
    input.addEventListener("blur", () => end(true));
    input.focus();
  }

  /** Selects the previous or next item in the displayed order. */
  step(by) {
    const ids = [...this.host.querySelectorAll(".item")].map((row) => row.dataset.id);
    if (!ids.length) return;
    const at = ids.indexOf(this.model.selected);
    const id = ids[Math.min(ids.length - 1, Math.max(0, at < 0 ? 0 : at + by))];
    this.model.jumpTo(id);
    return id;
  }

  #key(event) {
    if (!event.target.closest(".item-main") || !["ArrowDown", "ArrowUp"].includes(event.key)) return;
    event.preventDefault();
    event.stopPropagation();
    const id = this.step(event.key === "ArrowDown" ? 1 : -1);
    this.host.querySelector(`[data-id="${id}"] .item-main`)?.focus();
  }
}
