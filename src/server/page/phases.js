// The phases of a series that shows one region several times, such as a 4D CT: a slider, and
// playing them one after another.
//
// Each phase is a volume. Camera, preset and crop stay; the server frames all phases alike.

import { Cine } from "./cine.js";
import { $ } from "./state.js";

/** The volumes that are phases of the same region, in their order; empty for other volumes. */
function phasesOf(volume, volumes) {
  if (!volume?.phase) return [];
  const same = volumes.filter(({ phase }) => phase?.series === volume.phase.series);
  return same.sort((a, b) => a.phase.number - b.phase.number);
}

/** Whether two volumes are phases of one region. */
export const arePhases = (one, other) => Boolean(one?.phase && other?.phase && one.phase.series === other.phase.series);

export class Phases {
  #phases = [];
  #volume = null;

  /** `show` gets the volume of a phase and whether it is one of many; `rest` shows the last one as a still picture. */
  constructor({ show, rest }) {
    this.show = show;
    const next = () => this.show(this.#behind(), true);
    this.cine = new Cine({ button: $("phases-play"), rate: $("phases-rate"), next, rest });
    $("phase").addEventListener("input", ({ target }) => {
      this.cine.stop();
      this.show(this.#phases[target.valueAsNumber], true);
    });
    $("phase").addEventListener("change", rest);
  }

  get exist() {
    return this.#phases.length > 1;
  }

  /** Updates the controls for a displayed volume. */
  fill(volume, volumes) {
    this.#volume = volume;
    this.#phases = phasesOf(volume, volumes);
    $("phases").hidden = !this.exist;
    if (!this.exist) return this.cine.stop();
    Object.assign($("phase"), { max: this.#phases.length - 1, value: this.#at() });
    $("phase-value").textContent = `${volume.phase.number} of ${volume.phase.count}`;
  }

  #at() {
    return this.#phases.findIndex(({ id }) => id === this.#volume.id);
  }

  #behind() {
    return this.#phases[(this.#at() + 1) % this.#phases.length];
  }
}
