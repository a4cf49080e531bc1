// The worker of the view synthesis: views are made beside the page, which stays responsive.
//
// Messages have a number, which the answer repeats; they are answered in their order. See synthesizer.js.

import { outputOf } from "./outputs.js";
import { Synthesis } from "./synthesis.js";

let synthesis = null;

const CALLS = {
  start({ query, profile }) {
    synthesis = new Synthesis(outputOf(new URLSearchParams(query)), profile, new OffscreenCanvas(1, 1));
    return {};
  },
  frame({ size, layers, display }) {
    synthesis.take(size, layers, display);
    return drawn();
  },
  give({ pixels }) {
    synthesis.give(pixels);
    return drawn();
  },
  follow({ eyes }) {
    return synthesis.follow(eyes) ? drawn() : {};
  },
};

/** The frame as a picture that is handed over, and how long it took, ms. */
function drawn() {
  const since = performance.now();
  const image = synthesis.draw().transferToImageBitmap();
  return { image, ms: performance.now() - since };
}

addEventListener("message", ({ data: { number, call, values } }) => {
  try {
    const answer = CALLS[call](values);
    postMessage({ number, ...answer }, answer.image ? [answer.image] : []);
  } catch (error) {
    postMessage({ number, error: error.message });
  }
});
