// The slider of an isosurface's value: visible in mode isosurface only. It has the value of the
// preset until the user moves it.

const $ = (id) => document.getElementById(id);

/** Position of the slider while the preset decides, HU. */
const USUAL_HU = 300;

/** Updates the slider from the state. */
export function describeSurface({ mode, iso, volume }) {
  $("iso-field").hidden = mode !== "isosurface";
  $("iso").value = iso ?? USUAL_HU;
  $("iso-value").textContent = iso === null ? "preset" : `${iso} ${volume?.unit ?? "HU"}`;
}

/** Writes the chosen value into the state and calls back. */
export function onSurface(state, changed) {
  $("iso").addEventListener("input", ({ target }) => {
    state.iso = Number(target.value);
    describeSurface(state);
    changed();
  });
}
