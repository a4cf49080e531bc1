// The controls of light: a set of placed lights, and the strength of ambient occlusion.

const $ = (id) => document.getElementById(id);

/** Strength of the shadows of placed lights. */
const SHADOWS = 0.85;
/** The default light. */
const USUAL = "headlight";
const CAST = ["composite", "isosurface"];

export const NO_LIGHT = Object.freeze({ lights: USUAL, occlusion: 0 });

/**
 * Query parameters of the light. Lights are attached to the viewer, so their shadows have to be computed again when the
 * volume rotates: there are none while it moves.
 */
export function lightQuery({ mode, light: { lights, occlusion } }, moving) {
  const isCast = CAST.includes(mode);
  const query = {};
  if (lights !== USUAL && (isCast || mode === "path-traced")) query.lights = lights;
  if (lights !== USUAL && isCast && !moving) query.shadows = SHADOWS;
  if (occlusion > 0 && isCast) query.occlusion = occlusion / 100;
  return query;
}

/** Updates the controls from the state; hides those without effect. */
export function describeLight({ mode, light: { lights, occlusion } }) {
  const isCast = CAST.includes(mode);
  $("lights-field").hidden = !isCast && mode !== "path-traced";
  $("occlusion-field").hidden = !isCast;
  $("lights").value = lights;
  $("occlusion").value = occlusion;
  $("occlusion-value").textContent = occlusion > 0 ? `${occlusion} %` : "off";
}

/** Fills the menu with the light sets of the server. */
export function fillLights(names) {
  $("lights").replaceChildren(...names.map((name) => new Option(name[0].toUpperCase() + name.slice(1), name)));
}

/** Writes the chosen light into the state and calls back. */
export function onLight(state, changed) {
  $("lights").addEventListener("change", ({ target }) => {
    state.light = { ...state.light, lights: target.value };
    changed();
  });
  $("occlusion").addEventListener("input", ({ target }) => {
    state.light = { ...state.light, occlusion: Number(target.value) };
    describeLight(state);
    changed();
  });
}

/** The part of the address for the light. */
export function keptLight({ lights, occlusion }) {
  return { ...(lights === USUAL ? {} : { lights }), ...(occlusion > 0 ? { occlusion } : {}) };
}

/** Reads the light from an address, limited to the entries of the menu. */
export function recalledLight(kept) {
  const names = [...$("lights").options].map((option) => option.value);
  const lights = names.includes(kept.get("lights")) ? kept.get("lights") : USUAL;
  const occlusion = Math.round(Math.min(100, Math.max(0, Number(kept.get("occlusion")) || 0)));
  return { lights, occlusion };
}
