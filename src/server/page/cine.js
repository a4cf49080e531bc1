// Cine: plays the slices of a plane one after another, and begins again behind the last one.
//
// The next slice is requested after the previous one is shown. A slow server plays more slowly, and
// no slice is left out.

/** Initial rate, slices per second. */
const RATE = 10;

export class Cine {
  #timer = 0;
  #since = 0;
  playing = false;

  /** `next` shows the slice after the present one; `rest` shows it as a still picture. */
  constructor({ button, rate, next, rest }) {
    Object.assign(this, { button, rate, next, rest });
    button.addEventListener("click", () => this.toggle());
    rate.value = RATE;
  }

  toggle() {
    if (this.playing) return this.stop();
    this.playing = true;
    this.#say();
    this.#advance();
  }

  stop() {
    if (!this.playing) return;
    clearTimeout(this.#timer);
    this.playing = false;
    this.#say();
    this.rest();
  }

  /** Called when a picture is displayed. */
  shown() {
    if (!this.playing) return;
    clearTimeout(this.#timer);
    const due = this.#since + 1000 / Math.max(1, this.rate.valueAsNumber || RATE);
    this.#timer = setTimeout(() => this.#advance(), Math.max(0, due - performance.now()));
  }

  #advance() {
    this.#since = performance.now();
    this.next();
  }

  #say() {
    this.button.textContent = this.playing ? "Stop" : "Play";
    this.button.setAttribute("aria-pressed", String(this.playing));
  }
}
