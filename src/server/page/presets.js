// The presets as a grid of thumbnails: one radio button each, with a small picture of the volume
// that is displayed.

import { Thumbnails } from "./thumbnails.js";

export class PresetGrid {
  #cells = [];

  /** `isBusy` returns whether thumbnails have to wait. Choosing one fires a `change` event of an input "preset". */
  constructor(box, isBusy) {
    this.box = box;
    this.thumbnails = new Thumbnails(box, isBusy);
  }

  /** Makes a cell for each preset. */
  fill(presets) {
    this.#cells = presets.map((preset, index) => cell(preset, index));
    this.box.replaceChildren(...this.#cells.map(({ label }) => label));
    this.thumbnails.watch(this.#cells);
  }

  /** Shows the presets whose name or purpose contains all words of a text; returns their number. */
  find(text) {
    const words = text.toLowerCase().split(/\s+/);
    const fits = ({ label, name }) => words.every((word) => `${name.replaceAll("-", " ")} ${label.title}`.toLowerCase().includes(word));
    for (const each of this.#cells) each.label.hidden = !fits(each);
    return this.#cells.filter(({ label }) => !label.hidden).length;
  }

  /** The number of the first visible preset. */
  get first() {
    const index = this.#cells.findIndex(({ label }) => !label.hidden);
    return index < 0 ? undefined : index;
  }

  /** Marks a preset as chosen and scrolls to it; -1 for none. */
  choose(index) {
    if (!this.#cells[index]) return this.#cells.forEach(({ input }) => (input.checked = false));
    const { input, label } = this.#cells[index];
    input.checked = true;
    label.scrollIntoView({ block: "nearest" });
  }

  /** Shows thumbnails of another volume: `path` is its address. */
  show(path) {
    this.thumbnails.load((index) => `${path}/presets/${this.#cells[index].name}/thumbnail`);
  }
}

function cell({ name, purpose }, index) {
  const label = document.createElement("label");
  const input = Object.assign(document.createElement("input"), { type: "radio", name: "preset", value: String(index) });
  // Decoration: screen readers read the name beside it.
  const image = Object.assign(document.createElement("img"), { alt: "", width: 160, height: 120 });
  const text = document.createElement("span");
  text.textContent = name.replaceAll("-", " ");
  label.title = purpose;
  label.append(input, image, text);
  return { name, label, input, image };
}
