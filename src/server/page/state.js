// The state of the main page, which its modules read and change.

import { ALL_SHOWN } from "./labels.js";
import { NO_LIGHT } from "./light.js";
import { NO_SLICE } from "./slices.js";
import { HOME } from "./view.js";

export const $ = (id) => document.getElementById(id);
export const DOT = " · ";
export const VIEWS = ["picture", "depth", "split", "frame"];

export const state = {
  volume: null,
  pose: { ...HOME, shift: null },
  slice: { ...NO_SLICE },
  /** Null for values that are not HU, which no preset suits. */
  preset: "bone",
  /** Settings that the user chose; others follow the anatomy of the volume. */
  own: { preset: false, window: false },
  mode: "composite",
  /** HU of the surface; the server's choice for the preset while null. */
  iso: null,
  light: { ...NO_LIGHT },
  overlays: [],
  labels: { ...ALL_SHOWN },
  /** The visible part: its lowest and highest corner in patient coordinates, mm; null is the whole volume. */
  crop: null,
  /** Clip planes, see `planes.js`. */
  planes: [],
  /** Whether the table is shown: "keep" or "remove". */
  table: "remove",
  /** How cut faces look: "lit" or "slice". */
  faces: "lit",
  fieldOfView: 22,
  view: "picture",
  layout: "wowvx",
  profile: "",
  factor: 64,
  offset: 128,
  depthFilter: "none",
  /** Empty for the rule that suits the layout. */
  depthRule: "",
  /** Preview of a 3D display over the picture: off, or a kind of `preview.js`. */
  preview: "",
  split: 0.5,
};

/** Whether a slice is displayed instead of the volume. */
export const slicing = () => state.slice.plane !== "" && state.volume !== null;

export const volumePath = (part) => `/v1/volumes/${state.volume.id}/${part}`;

/** Opens the help; scrolls to its beginning although the focused button is at the end. */
export function showHelp() {
  $("help").showModal();
  $("help").scrollTop = 0;
}

/** Marks the radio button of a value. */
export function choose(name, value) {
  const input = $("panel").querySelector(`input[name="${name}"][value="${value}"]`);
  if (input) input.checked = true;
}

export const overlayBoxes = () => [...$("panel").querySelectorAll('input[name="overlay"]')];
