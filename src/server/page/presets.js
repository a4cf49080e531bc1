// The presets as a grid of thumbnails: one radio button each, with a small picture of the volume
// that is displayed.
//
// Thumbnails are requested one at a time, only visible ones, and only while no other picture is rendered.

/** Delays before trying again: while other pictures are rendered, and after a failure, ms. */
const PAUSE_MS = 150;
const AFTER_FAILURE_MS = 2000;
const MOST_TRIES = 3;

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

export class PresetGrid {
  #cells = [];
  #inSight = new Set();
  #path = null;
  #loading = false;

  /** `isBusy` returns whether thumbnails have to wait. Choosing one fires a `change` event of an input "preset". */
  constructor(box, scroller, isBusy) {
    Object.assign(this, { box, isBusy });
    this.observer = new IntersectionObserver((entries) => this.#look(entries), { root: scroller, rootMargin: "80px" });
  }

  /** Makes a cell for each preset. */
  fill(presets) {
    this.#cells = presets.map((preset, index) => cell(preset, index));
    this.box.replaceChildren(...this.#cells.map(({ label }) => label));
    for (const { label } of this.#cells) this.observer.observe(label);
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

  /** Marks a preset as chosen and scrolls to it. */
  choose(index) {
    const { input, label } = this.#cells[index];
    input.checked = true;
    label.scrollIntoView({ block: "nearest" });
  }

  /** Shows thumbnails of another volume: `path` is its address. */
  show(path) {
    this.#path = path;
    for (const each of this.#cells) Object.assign(each, { shown: null, tries: 0 });
    this.#load();
  }

  #look(entries) {
    for (const { target, isIntersecting } of entries) {
      const each = this.#cells.find(({ label }) => label === target);
      if (isIntersecting) this.#inSight.add(each);
      else this.#inSight.delete(each);
    }
    this.#load();
  }

  #next() {
    const missing = (each) => this.#inSight.has(each) && each.shown !== this.#path && each.tries < MOST_TRIES;
    return this.#cells.find(missing);
  }

  async #load() {
    if (this.#loading || !this.#path) return;
    this.#loading = true;
    for (let each = this.#next(); each; each = this.#next()) {
      while (this.isBusy() || document.hidden) await pause(PAUSE_MS);
      const path = this.#path;
      each.image.src = `${path}/presets/${each.name}/thumbnail`;
      try {
        await each.image.decode();
        each.shown = path;
        each.image.classList.add("there");
      } catch {
        each.tries += 1;
        await pause(AFTER_FAILURE_MS);
      }
    }
    this.#loading = false;
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
  return { name, label, input, image, shown: null, tries: 0 };
}
