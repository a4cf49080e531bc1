// The menu of volumes: a radio button for each, with a picture, its name and its size.

import { Thumbnails } from "./thumbnails.js";

export class VolumeMenu {
  #volumes = [];
  #inputs = [];

  /** `box` gets the radio buttons; calls `chosen` with a volume. `isBusy` returns whether pictures have to wait. */
  constructor(box, { chosen, isBusy }) {
    this.box = box;
    this.thumbnails = new Thumbnails(box, isBusy);
    box.addEventListener("change", (event) => {
      event.stopPropagation();
      chosen(this.#volumes[this.#inputs.indexOf(event.target)]);
    });
  }

  /** Lists the volumes of the server. A picture has the preset that suits its volume. */
  fill(volumes) {
    const ids = (list) => list.map(({ id }) => id).join();
    if (ids(volumes) === ids(this.#volumes)) return;
    this.#volumes = volumes;
    const cells = volumes.map(cell);
    this.#inputs = cells.map(({ input }) => input);
    this.box.replaceChildren(...cells.map(({ label }) => label));
    this.thumbnails.watch(cells);
    this.thumbnails.load((index) => thumbnailOf(volumes[index]));
  }

  /** Marks the volume that is displayed. */
  choose(id) {
    const input = this.#inputs[this.#volumes.findIndex((volume) => volume.id === id)];
    if (input) input.checked = true;
  }
}

/** Names the unit of a volume's values beside the inputs of values. */
export function nameUnit({ unit }) {
  for (const label of document.querySelectorAll("[data-value-unit]")) label.textContent = unit;
}

/** The picture of a volume for menus: no preset suits values that are not HU. */
const thumbnailOf = ({ id, anatomy: { preset } }) =>
  preset ? `/v1/volumes/${id}/presets/${preset}/thumbnail` : `/v1/volumes/${id}/frame?layout=color&size_px=160,120`;

function cell({ name, dims }, index) {
  const label = document.createElement("label");
  const input = Object.assign(document.createElement("input"), { type: "radio", name: "volume", value: String(index) });
  // Decoration: screen readers read the name beside it.
  const image = Object.assign(document.createElement("img"), { alt: "", width: 160, height: 120 });
  const text = Object.assign(document.createElement("span"), { textContent: name, title: name });
  const voxels = dims.join(" × ");
  // A name without a description has the size already.
  const size = Object.assign(document.createElement("small"), { textContent: name.includes(voxels) ? "" : voxels });
  label.append(input, image, text, size);
  return { label, input, image };
}
