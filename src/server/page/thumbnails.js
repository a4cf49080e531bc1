// Loads thumbnails one at a time, only visible ones, and only while no other picture is rendered.

/** Delays before trying again: while other pictures are rendered, and after a failure, ms. */
const PAUSE_MS = 150;
const AFTER_FAILURE_MS = 2000;
const MOST_TRIES = 3;

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

export class Thumbnails {
  /** Images by their watched elements: `{ image, address, shown, tries }`. */
  #entries = new Map();
  #inSight = new Set();
  #loading = false;

  /** `isBusy` returns whether thumbnails have to wait. */
  constructor(scroller, isBusy) {
    this.isBusy = isBusy;
    this.observer = new IntersectionObserver((seen) => this.#look(seen), { root: scroller, rootMargin: "80px" });
  }

  /** Replaces the watched elements: `cells` are `{ label, image }`, the image inside its label. */
  watch(cells) {
    this.observer.disconnect();
    this.#inSight.clear();
    this.#entries = new Map(cells.map(({ label, image }) => [label, { image, address: null, shown: null, tries: 0 }]));
    for (const label of this.#entries.keys()) this.observer.observe(label);
  }

  /** Sets the address of every image: `addressOf` gets its index. */
  load(addressOf) {
    [...this.#entries.values()].forEach((entry, index) => Object.assign(entry, { address: addressOf(index), tries: 0 }));
    this.#run();
  }

  #look(seen) {
    for (const { target, isIntersecting } of seen) {
      if (isIntersecting) this.#inSight.add(target);
      else this.#inSight.delete(target);
    }
    this.#run();
  }

  #next() {
    const label = [...this.#inSight].find((label) => {
      const { address, shown, tries } = this.#entries.get(label) ?? {};
      return address && shown !== address && tries < MOST_TRIES;
    });
    return this.#entries.get(label);
  }

  async #run() {
    if (this.#loading) return;
    this.#loading = true;
    for (let entry = this.#next(); entry; entry = this.#next()) {
      while (this.isBusy() || document.hidden) await pause(PAUSE_MS);
      const { address, image } = entry;
      image.src = address;
      try {
        await image.decode();
        entry.shown = address;
        image.classList.add("there");
      } catch {
        entry.tries += 1;
        await pause(AFTER_FAILURE_MS);
      }
    }
    this.#loading = false;
  }
}
