// The choice of volume, author, set and cursor, and the settings of the views.

import { Crop } from "/crop.js";
import { spacingWords } from "/lengths.js";
import { Planes } from "/planes.js";
import { request } from "/view.js";
import { identityOf, showWarnings } from "/series.js";
import { VolumeMenu, nameUnit } from "/volumes.js";
import { places } from "./geometry.js";

const $ = (id) => document.getElementById(id);
const DOT = " · ";

const initials = (name) => name.split(/\s+/).map((word) => word[0]).slice(0, 2).join("").toUpperCase();

export const pageFacts = {
  /** The preset and the window that suit the volume, where the user chose none. */
  look(model) {
    const { preset, window_hu: [center, width] } = model.volume.anatomy;
    if (!model.hasOwnPreset) $("preset").value = model.preset = preset ?? "";
    if (!model.window.isOwn) model.window = { center, width, isOwn: false };
    model.changed("window");
  },

  volume(volume) {
    const { id, dims, hu_range: [low, high] } = volume;
    $("series").textContent = identityOf(volume);
    nameUnit(volume);
    $("series").hidden = !$("volume-field").hidden; // the menu has it
    showWarnings($("series-warnings"), volume);
    const size = `${dims.join(" × ")} voxels`;
    $("volume-facts").textContent = [size, spacingWords(volume), `${low} to ${high} ${volume.unit}`].join(DOT);
    this.menu?.choose(id);
    $("volume-menu").querySelector("summary").textContent = identityOf(volume);
    history.replaceState(null, "", `#volume=${id}`);
  },

  volumes(volumes, choose, isBusy) {
    const chosen = (volume) => {
      choose(volume);
      $("volume-menu").open = false;
    };
    this.menu = new VolumeMenu($("volumes"), { chosen, isBusy });
    this.menu.fill(volumes);
    $("volume-field").hidden = volumes.length < 2;
  },

  author({ author }) {
    const mark = document.createElement("b");
    mark.textContent = author ? initials(author) : "?";
    $("author").replaceChildren(mark, author || "Who are you?");
  },

  sets({ sets, items, set }) {
    const names = new Set([set, ...sets.map(({ name }) => name), ...[...items.values()].map(({ item }) => item.set)]);
    const words = (name) => (sets.find((known) => known.name === name)?.blinded ? `${name} (blinded)` : name);
    $("set").replaceChildren(...[...names].sort().map((name) => new Option(words(name), name)), new Option("New set …", ""));
    $("set").value = set;
  },

  readout({ cursor: { mm, hu }, volume }) {
    const value = hu === null ? "" : `${Math.round(hu)} ${volume.unit}`;
    $("readout").textContent = [places(mm), `LPS ${mm.map((part) => part.toFixed(2)).join(", ")} mm`, value].filter(Boolean).join(DOT);
    Object.assign($("readout").dataset, { mm: mm.map((part) => part.toFixed(4)).join(","), hu: hu ?? "" });
  },
};

/** Crop, clip planes and table of the 3D view. */
function onCrop(model, panes) {
  const [pane] = panes;
  const layer = document.createElement("div");
  Object.assign(layer, { className: "crop-layer", hidden: true });
  layer.innerHTML = '<svg viewBox="0 0 100 100" preserveAspectRatio="none" aria-hidden="true"><path /></svg>';
  pane.root.append(layer);
  const changed = (change, moving = false) => {
    Object.assign(model, change);
    pane.refresh(moving);
  };
  pane.crop = new Crop({ panel: $("crop-sides"), layer, group: $("crop-group"), state: model, shown: () => pane.shown, changed });
  // Slices outline the table where the 3D view leaves it out.
  $("table").addEventListener("change", ({ target }) => {
    model.table = target.checked ? "keep" : "remove";
    panes.forEach((each) => each.refresh());
  });
  pane.planes = new Planes({ list: $("crop-planes"), button: $("crop-add-plane"), state: model, changed });
  $("crop-reset").addEventListener("click", () => {
    changed({ crop: null, planes: [] });
    pane.planes.draw();
  });
}

/** Fills and wires the settings of the views. */
export async function onSettings(model, panes) {
  const { presets } = await (await request("/v1/presets")).json();
  const none = Object.assign(new Option("all values", ""), { hidden: true });
  $("preset").replaceChildren(...presets.map(({ name }) => new Option(name.replaceAll("-", " "), name)), none);
  $("preset").value = model.preset;
  $("preset").addEventListener("change", ({ target }) => {
    Object.assign(model, { preset: target.value, hasOwnPreset: true });
    panes[0].refresh();
  });
  $("window").addEventListener("change", ({ target }) => {
    const [center, width] = target.value.split(",").map(Number);
    model.window = { center, width, isOwn: true };
    model.changed("window");
  });
  model.on("window", () => {
    const value = `${model.window.center},${model.window.width}`;
    const known = [...$("window").options];
    known.at(-1).textContent = `by hand: ${model.window.center} ± ${model.window.width / 2} ${model.volume?.unit ?? "HU"}`;
    $("window").value = known.some((option) => option.value === value) ? value : "";
  });
  onCrop(model, panes);
  $("follows").addEventListener("change", ({ target }) => {
    model.oblique = { ...model.oblique, follows: target.checked };
    model.changed("pose", "cursor");
  });
}
