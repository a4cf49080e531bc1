// The slider of an isosurface's value: there in mode isosurface only, and the preset's own value
// until it is moved.

const $ = (id) => document.getElementById(id);

/** Where the slider stands while the value is the preset's, HU. */
const USUAL_HU = 300;

/** Shows what the state has. */
export function describeSurface({ mode, iso }) {
  $("iso-field").hidden = mode !== "isosurface";
  $("iso").value = iso ?? USUAL_HU;
  $("iso-value").textContent = iso === null ? "preset" : `${iso} HU`;
}

/** Puts a value that is chosen into the state, and says so. */
export function onSurface(state, changed) {
  $("iso").addEventListener("input", ({ target }) => {
    state.iso = Number(target.value);
    describeSurface(state);
    changed();
  });
}
