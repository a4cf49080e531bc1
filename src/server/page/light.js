// The controls of light: a set of placed lights, and the strength of ambient occlusion.

const $ = (id) => document.getElementById(id);

/** How much of the shadows of placed lights shows. */
const SHADOWS = 0.85;
/** The light that there is without any. */
const USUAL = "headlight";
const CAST = ["composite", "isosurface"];

export const NO_LIGHT = Object.freeze({ lights: USUAL, occlusion: 0 });

/**
 * Query parameters of the light. The lights go with the viewer, so that their shadows have to be made anew whenever the
 * volume turns: while it moves there are none.
 */
export function lightQuery({ mode, light: { lights, occlusion } }, moving) {
  const isCast = CAST.includes(mode);
  const query = {};
  if (lights !== USUAL && (isCast || mode === "path-traced")) query.lights = lights;
  if (lights !== USUAL && isCast && !moving) query.shadows = SHADOWS;
  if (occlusion > 0 && isCast) query.occlusion = occlusion / 100;
  return query;
}

/** Shows what the state has; the controls are there where they do something. */
export function describeLight({ mode, light: { lights, occlusion } }) {
  const isCast = CAST.includes(mode);
  $("lights-field").hidden = !isCast && mode !== "path-traced";
  $("occlusion-field").hidden = !isCast;
  $("lights").value = lights;
  $("occlusion").value = occlusion;
  $("occlusion-value").textContent = occlusion > 0 ? `${occlusion} %` : "off";
}

/** Fills the menu with the sets of lights that the server has. */
export function fillLights(names) {
  $("lights").replaceChildren(...names.map((name) => new Option(name[0].toUpperCase() + name.slice(1), name)));
}

/** Puts what is chosen into the state, and says so. */
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

/** What an address keeps of the light. */
export function keptLight({ lights, occlusion }) {
  return { ...(lights === USUAL ? {} : { lights }), ...(occlusion > 0 ? { occlusion } : {}) };
}

/** The light of an address, of what the menu has. */
export function recalledLight(kept) {
  const names = [...$("lights").options].map((option) => option.value);
  const lights = names.includes(kept.get("lights")) ? kept.get("lights") : USUAL;
  const occlusion = Math.round(Math.min(100, Math.max(0, Number(kept.get("occlusion")) || 0)));
  return { lights, occlusion };
}
