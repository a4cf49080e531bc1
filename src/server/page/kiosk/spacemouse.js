// A SpaceMouse over WebHID: the cap turns, shifts and zooms the view. While the first button is held, the
// cap moves the cursor. The second button places a landmark.
//
// Reports have the axes x right, y towards the user, z down, and the rotations about them, each up to
// 350. Report 1 has the shift, or all six numbers; report 2 the rotation; report 3 one bit for each button. The
// view has the axes x right, y up, z towards the viewer. Speeds are those of `relief client --pointer spacemouse`.

const FILTERS = [{ vendorId: 0x256f }, { vendorId: 0x046d, usagePage: 1, usage: 8 }];
const FULL = 350;
const TURN_DEG_S = 120;
const PAN_S = 0.8;
const ZOOM_S = 1.2;
const CURSOR_MM_S = 60;
/** Longest time that one report counts for, s. */
const LONGEST_S = 0.05;

const clamped = (value) => Math.min(1, Math.max(-1, value / FULL));
const inViewAxes = ([x, y, z]) => [x, -z, y];

export class SpaceMouse {
  #device = null;
  #moved = 0;
  #turned = 0;
  #buttons = 0;

  /** `send` gets intents, `changed` gets status messages. */
  constructor({ send, changed }) {
    Object.assign(this, { send, changed });
    navigator.hid?.addEventListener("disconnect", ({ device }) => {
      if (device !== this.#device) return;
      device.removeEventListener("inputreport", this.#take);
      [this.#device, this.#buttons] = [null, 0];
      this.changed("The SpaceMouse is gone.");
    });
    navigator.hid?.addEventListener("connect", () => this.#device || this.reopen());
  }

  /** Asks the user for a SpaceMouse. Needs a click or a key. */
  async choose() {
    const [device] = await navigator.hid.requestDevice({ filters: FILTERS });
    if (device) await this.#open(device);
  }

  /** Opens a SpaceMouse that the user allowed before. */
  async reopen() {
    const known = (await navigator.hid?.getDevices()) ?? [];
    const found = known.find(({ vendorId }) => FILTERS.some((filter) => filter.vendorId === vendorId));
    if (found) await this.#open(found);
  }

  async #open(device) {
    try {
      if (!device.opened) await device.open();
    } catch (error) {
      return this.changed(`The SpaceMouse cannot be opened: ${error.message}`);
    }
    this.#device = device;
    device.addEventListener("inputreport", this.#take);
    this.changed("");
  }

  #take = ({ reportId: id, data }) => {
    const numbers = Array.from({ length: Math.floor(data.byteLength / 2) }, (_, at) => clamped(data.getInt16(2 * at, true)));
    if (id === 1 && numbers.length >= 3) this.#shift(inViewAxes(numbers.slice(0, 3)));
    if (id === 1 && numbers.length >= 6) this.#turn(inViewAxes(numbers.slice(3, 6)));
    if (id === 2 && numbers.length >= 3) this.#turn(inViewAxes(numbers.slice(0, 3)));
    if (id === 3 && data.byteLength) this.#press(data.getUint8(0));
  };

  #shift([right, up, near]) {
    const now = performance.now();
    const seconds = Math.min(LONGEST_S, (now - this.#moved) / 1000);
    this.#moved = now;
    if (this.#buttons & 1) {
      const by_view_mm = [right, up, near].map((share) => share * CURSOR_MM_S * seconds);
      if (right || up || near) this.send({ intent: "cursor", by_view_mm });
      return;
    }
    if (right || up) this.send({ intent: "pan", right: right * PAN_S * seconds, up: up * PAN_S * seconds });
    if (near) this.send({ intent: "zoom", factor: Math.exp(near * ZOOM_S * seconds) });
  }

  #turn(about) {
    const now = performance.now();
    const seconds = Math.min(LONGEST_S, (now - this.#turned) / 1000);
    this.#turned = now;
    const share = Math.hypot(...about);
    if (!share || this.#buttons & 1) return;
    const half = (share * TURN_DEG_S * seconds * Math.PI) / 360;
    const [x, y, z] = about.map((part) => (part / share) * Math.sin(half));
    this.send({ intent: "turn", rotation_xyzw: [x, y, z, Math.cos(half)] });
  }

  #press(buttons) {
    if (buttons & 2 && !(this.#buttons & 2)) this.send({ intent: "place", phase: "commit" });
    this.#buttons = buttons;
  }
}
