// A Wiimote over WebHID: initialises its camera step by step, and forwards its reports unchanged.
//
// Each step waits for its acknowledgement; a camera that is initialised too fast has a random sensitivity.
// Initialisation is repeated after an unrequested status report (reporting stopped), a report with
// another id (a driver set its own mode), or silence.

const FILTERS = [{ vendorId: 0x057e, productId: 0x0306 }, { vendorId: 0x057e, productId: 0x0330 }];
/** Buttons, acceleration and the camera's blobs with their sizes. */
const MODE = 0x33;
const ANSWER_MS = 200;
const SILENCE_MS = 1000;
const MOST_TRIES = 10;

const register = (address, bytes) => ({
  id: 0x16, bytes: [0x04, (address >> 16) & 0xff, (address >> 8) & 0xff, address & 0xff, bytes.length,
    ...bytes, ...new Array(16 - bytes.length).fill(0)],
});
const SET_MODE = { id: 0x12, bytes: [0x06, MODE] };
/** Order and sensitivity as in the Linux driver. */
const STEPS = [
  { id: 0x13, bytes: [0x06] },
  { id: 0x1a, bytes: [0x06] },
  register(0xb00030, [0x01]),
  register(0xb00000, [0x02, 0, 0, 0x71, 0x01, 0, 0xaa, 0, 0x64]),
  register(0xb0001a, [0x63, 0x03]),
  register(0xb00033, [0x03]),
  register(0xb00030, [0x08]),
  SET_MODE,
];

const hex = (byte) => byte.toString(16).padStart(2, "0");

export class Wiimote {
  #device = null;
  #step = 0;
  #tries = 0;
  #sent = 0;
  #heard = 0;

  /** `report` gets hexadecimal digits beginning with the report id, `changed` gets status messages. */
  constructor({ report, changed }) {
    Object.assign(this, { report, changed });
    navigator.hid?.addEventListener("disconnect", ({ device }) => {
      if (device === this.#device) this.#close("The Wiimote is gone.");
    });
    navigator.hid?.addEventListener("connect", () => this.#device || this.reopen());
    setInterval(() => this.#watch(), ANSWER_MS / 2);
  }

  static get isPossible() {
    return Boolean(navigator.hid);
  }

  /** Asks the user for a Wiimote. Needs a click or a key. */
  async choose() {
    const [device] = await navigator.hid.requestDevice({ filters: FILTERS });
    if (device) await this.#open(device);
  }

  /** Opens a Wiimote that the user allowed before. */
  async reopen() {
    const known = (await navigator.hid?.getDevices()) ?? [];
    const found = known.find((device) => FILTERS.some((f) => f.vendorId === device.vendorId && f.productId === device.productId));
    if (found) await this.#open(found);
  }

  async #open(device) {
    try {
      if (!device.opened) await device.open();
    } catch (error) {
      return this.changed(`The Wiimote cannot be opened: ${error.message}`);
    }
    this.#device = device;
    device.addEventListener("inputreport", this.#take);
    this.changed("Starting the Wiimote's camera.");
    this.#restart();
  }

  #close(words) {
    this.#device?.removeEventListener("inputreport", this.#take);
    this.#device = null;
    this.changed(words);
  }

  #restart() {
    [this.#step, this.#tries, this.#heard] = [0, 0, performance.now()];
    this.#sendStep();
  }

  #write({ id, bytes }) {
    this.#device?.sendReport(id, new Uint8Array(bytes)).catch((error) => this.#close(`Cannot write to the Wiimote: ${error.message}`));
  }

  #sendStep() {
    this.#tries += 1;
    if (this.#tries > MOST_TRIES) return this.#close("The device refuses what every Wiimote takes.");
    this.#sent = performance.now();
    this.#write(STEPS[this.#step]);
  }

  #watch() {
    if (!this.#device) return;
    const now = performance.now();
    if (this.#step < STEPS.length) {
      if (now - this.#sent > ANSWER_MS) this.#sendStep();
    } else if (now - this.#heard > SILENCE_MS) {
      this.#restart();
    }
  }

  #take = ({ reportId, data }) => {
    this.#heard = performance.now();
    const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
    if (this.#step < STEPS.length) {
      const answers = reportId === 0x22 && bytes[2] === STEPS[this.#step].id;
      if (!answers) return;
      if (bytes[3] !== 0) return this.#sendStep();
      [this.#step, this.#tries] = [this.#step + 1, 0];
      if (this.#step < STEPS.length) this.#sendStep();
      else this.changed("");
      return;
    }
    const stopped = reportId === 0x20 || (reportId >= 0x30 && reportId !== MODE);
    if (stopped && performance.now() - this.#sent > ANSWER_MS) {
      this.#sent = performance.now();
      this.#write(SET_MODE);
    }
    if (reportId === MODE) this.report(hex(reportId) + Array.from(bytes, hex).join(""));
  };
}
