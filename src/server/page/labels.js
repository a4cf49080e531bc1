// The segments of a volume with a label map: a list with a check box and a colour for each, an
// entry for voxels without a segment, and the strength of the tint.

/** Modes that show segments, apart from slices. */
const SHOWN_BY = ["composite", "mip", "minip"];
/** The label of voxels without a segment. */
const NONE = 0;
const USUAL_TINT = 50;

/** Hidden labels, and the tint in percent. */
export const ALL_SHOWN = Object.freeze({ cut: [], tint: USUAL_TINT });

const $ = (id) => document.getElementById(id);

/** Query parameters for the segments of the state's volume; none without segments or in modes that do not show them. */
export function labelQuery({ labels, volume, mode, slice }) {
  if (!volume?.segments || !(slice.plane || SHOWN_BY.includes(mode))) return {};
  const cut = labels.cut.length ? { cut_labels: labels.cut.join(",") } : {};
  return { ...cut, label_tint: labels.tint / 100 };
}

/** The part of the address for segments; defaults are left out. */
export function kept({ cut, tint }) {
  return { ...(cut.length ? { cut: cut.join(",") } : {}), ...(tint === USUAL_TINT ? {} : { tint }) };
}

/** Reads the state of segments from an address. */
export function recalled(words) {
  const cut = (words.get("cut") ?? "").split(",").filter(Boolean).map(Number);
  const tint = Number(words.get("tint") ?? USUAL_TINT);
  return {
    cut: cut.filter((label) => Number.isInteger(label) && label >= 0 && label < 65536),
    tint: tint >= 0 && tint <= 100 ? tint : USUAL_TINT,
  };
}

function row(label, text, title, rgb) {
  const line = document.createElement("label");
  const box = Object.assign(document.createElement("input"), { type: "checkbox", name: "segment", value: label });
  const swatch = document.createElement("i");
  const name = document.createElement("span");
  if (rgb) swatch.style.background = `rgb(${rgb.map((channel) => Math.round(255 * channel)).join(" ")})`;
  name.textContent = text;
  line.title = title;
  line.append(box, swatch, name);
  return line;
}

/** Lists the segments of a volume, those with voxels in it. */
export function showSegments(volume, labels) {
  const segments = (volume?.segments ?? []).filter(({ voxels }) => voxels > 0);
  $("segments-field").hidden = !volume?.segments;
  $("segments").replaceChildren(
    ...segments.map(({ label, name, rgb, volume_ml: ml }) =>
      row(label, name ?? `segment ${label}`, `label ${label}, ${ml.toFixed(ml < 10 ? 2 : 0)} ml`, rgb)),
    row(NONE, "everything else", "what has no segment", null),
  );
  describe(labels);
}

const boxes = () => [...$("segments").querySelectorAll("input")];

function describe({ cut, tint }) {
  for (const box of boxes()) box.checked = !cut.includes(Number(box.value));
  $("label-tint").value = tint;
  $("label-tint-value").textContent = `${tint} %`;
}

/** Calls back when segments change, with whether the control is still moving. */
export function onSegments(current, changed) {
  const change = (part, moving = false) => {
    const labels = { ...current(), ...part };
    describe(labels);
    changed(labels, moving);
  };
  const unchecked = () => boxes().filter((box) => !box.checked).map((box) => Number(box.value));
  $("segments").addEventListener("change", () => change({ cut: unchecked() }));
  $("segments-all").addEventListener("click", () => change({ cut: [] }));
  $("segments-only").addEventListener("click", () => change({ cut: [NONE] }));
  $("segments-none").addEventListener("click", () => {
    change({ cut: boxes().map((box) => Number(box.value)).filter((label) => label !== NONE) });
  });
  $("label-tint").addEventListener("input", ({ target }) => change({ tint: Number(target.value) }, true));
}
