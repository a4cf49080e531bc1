// The main page's keyboard. A focused control that uses arrows keeps them.

import { $, showHelp, slicing, state } from "./state.js";

const SIDES = { a: [0, 0], p: [180, 0], l: [90, 0], r: [-90, 0], s: [0, 90], i: [0, -90] };
const TURNING = /^(Arrow.*|Home|[+=\-_0])$/;
const ZOOM = 1.15;
const RATIOS = { "+": ZOOM, "=": ZOOM, "-": 1 / ZOOM, _: 1 / ZOOM };
/** Rotation of each arrow: steps of azimuth and elevation. */
const TURNS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
/** Distance that an arrow moves the picture, in fractions of its height. */
const STEP = 0.05;
const SHIFTS = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] };
const PAGES = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 };

/** `moves` has the actions of the page: pose, slice, zoom, pan, plane, reset and so on. */
export function onKeys(moves) {
  const turnOrZoom = ({ key, shiftKey, ctrlKey }) => {
    if (RATIOS[key]) return moves.zoom(RATIOS[key]);
    if (ctrlKey && SHIFTS[key]) return moves.pan(SHIFTS[key]);
    if (slicing()) return PAGES[key] ? moves.page(shiftKey ? 10 * PAGES[key] : PAGES[key]) : moves.reset();
    if (!TURNS[key]) return moves.reset();
    const [azimuth, elevation] = TURNS[key].map((part) => part * (shiftKey ? 1 : 6));
    moves.pose({ azimuth: state.pose.azimuth + azimuth, elevation: state.pose.elevation + elevation });
  };

  const command = (key) => {
    if (SIDES[key]) {
      if (slicing()) moves.plane("");
      const [azimuth, elevation] = SIDES[key];
      return moves.pose({ azimuth, elevation }, { moving: false });
    }
    if (/^[1-9]$/.test(key)) return moves.preset(Number(key) - 1);
    switch (key) {
      case "d": return moves.nextView();
      case "m": return moves.nextMode();
      case "v": return moves.nextPlane();
      case "f": return moves.fullScreen();
      case "c": return moves.cine();
      case "?": return showHelp();
      case "escape": return moves.forget();
    }
  };

  document.addEventListener("keydown", (event) => {
    const at = event.target;
    const shifts = event.ctrlKey && Boolean(SHIFTS[event.key]) && !event.metaKey && !event.altKey;
    if ((event.ctrlKey && !shifts) || event.metaKey || event.altKey || $("help").open || at.closest("select, dialog")) return;
    if (TURNING.test(event.key)) {
      if (at.matches("input") || at === $("divider")) return;
      event.preventDefault();
      turnOrZoom(event);
    } else if (!at.matches("input[type=number], input[type=search]") || event.key === "Escape") {
      command(event.key.toLowerCase());
    }
  });
}
