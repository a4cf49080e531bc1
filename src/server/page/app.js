// The page: wires controls, pointer and keyboard to the state, and the state to the stage.

import { recall, remember } from "./address.js";
import { showArchives } from "./archives.js";
import { Cine } from "./cine.js";
import { Crop, describeFaces } from "./crop.js";
import { Planes } from "./planes.js";
import { VolumeMenu, nameUnit } from "./volumes.js";
import { onFile, saveAs, uploadZip } from "./files.js";
import { onDivider, onGestures } from "./gestures.js";
import { showIdentity } from "./identity.js";
import { onKeys } from "./keys.js";
import { onSegments, showSegments } from "./labels.js";
import { spacingWords } from "./lengths.js";
import { describeLight, fillLights, onLight } from "./light.js";
import { notify, showFailure } from "./notice.js";
import { fitOf, normalized, shifted, zoomedAt } from "./orbit.js";
import { Phases, arePhases } from "./phases.js";
import { Picks } from "./picks.js";
import { PresetGrid } from "./presets.js";
import { Preview } from "./preview.js";
import { PLANES, advanced, dragged, onControls, paged, showControls, sliceWords, windowed, zoomed } from "./slices.js";
import { identityOf, offerOthers, showWarnings } from "./series.js";
import { Stage } from "./stage.js";
import { $, DOT, VIEWS, choose, overlayBoxes, showHelp, slicing, state, volumePath } from "./state.js";
import { describeSurface, onSurface } from "./surface.js";
import { HOME, frameQuery, request } from "./view.js";

const panel = $("panel");
let presets = [];
let volumes = [];
/** The id of the volume that the address names, until one is displayed. */
let linked = null;

const stage = new Stage({ asked, drawn });
const picks = new Picks(() => stage.shown);
const preview = new Preview($("preview"), panel.querySelectorAll('input[name="preview"]'), $("preview-words"), state, { chosen: remember, fail: showFailure });
const grid = new PresetGrid($("presets"), () => stage.isBusy);
const volumeMenu = new VolumeMenu($("volumes"), { chosen: showVolume, isBusy: () => stage.isBusy });
const refresh = (how) => stage.refresh(how);
const cine = new Cine({
  button: $("cine"), rate: $("cine-rate"), rest: refresh,
  next: () => setSlice((slice) => advanced(slice, state.volume)),
});

const phases = new Phases({ show: showPhase, rest: refresh });

const crop = new Crop({
  panel: $("crop-sides"), layer: $("crop-layer"), group: $("crop-group"), state, shown: () => stage.shown, changed: setCrop,
});

const planes = new Planes({ list: $("crop-planes"), button: $("crop-add-plane"), state, changed: setCrop });

function setCrop(change, moving = false) {
  Object.assign(state, change);
  refresh({ moving });
}

function drawn() {
  picks.draw();
  crop.draw();
  planes.draw();
  cine.shown();
  phases.cine.shown();
}

function asked() {
  preview.changed();
  describe();
}

/** Displays the direction of view, and keeps it in the address. */
function describe() {
  const { azimuth, elevation, zoom, shift } = state.pose;
  const pose = [`azimuth ${azimuth.toFixed(0)}°`, `elevation ${elevation.toFixed(0)}°`, `zoom ${zoom.toFixed(2)}`];
  const slice = slicing() ? sliceWords(state.slice, state.volume) : null;
  $("pose").textContent = (slice ?? [...pose, ...(shift ? ["moved"] : [])]).join(DOT);
  const what = slice ? `slice, ${slice.join(", ")}` : `volume, ${state.preset ? `preset ${state.preset}` : "all values"}, ${pose.slice(0, 2).join(", ")}`;
  $("picture").setAttribute("aria-label", `${state.view} of the ${what}`);
  showControls($, state.slice, state.volume);
  $("divider").hidden = state.view !== "split";
  $("divider").style.left = `${state.split * 100}%`;
  $("divider").setAttribute("aria-valuenow", Math.round(state.split * 100));
  remember();
}

// ---------------------------------------------------------------- moving

const aspect = () => stage.size[0] / stage.size[1];

function setSlice(change, moving = true) {
  if (!state.volume) return;
  const before = state.slice;
  state.slice = change(before);
  state.own.window ||= state.slice.center !== before.center || state.slice.width !== before.width;
  refresh({ moving });
}

function setPose(change, { moving = true } = {}) {
  state.pose = normalized({ ...state.pose, ...change });
  refresh({ moving });
}

/** Switches to a plane through the same position, or back to the volume. */
function showPlane(plane) {
  if (plane !== state.slice.plane) cine.stop();
  state.slice = { ...state.slice, plane };
  choose("plane", plane);
  refresh();
}

/** Moves the picture by fractions of its height, to the right and down. */
function pan(by) {
  if (!state.volume) return;
  if (slicing()) return setSlice((slice) => dragged(slice, state.volume, by, aspect()));
  setPose(shifted(state.pose, state.volume, state.fieldOfView, fitOf(stage.size, state.volume), by));
}

function zoom(ratio, at) {
  if (!state.volume) return;
  if (slicing()) return setSlice((slice) => zoomed(slice, ratio, state.volume, aspect(), at));
  if (!at) return setPose({ zoom: state.pose.zoom * ratio });
  setPose(zoomedAt(state.pose, state.volume, state.fieldOfView, stage.size, ratio, at));
}

function page(steps) {
  cine.stop();
  setSlice((slice) => paged(slice, state.volume, steps));
}

function reset() {
  picks.forget();
  if (slicing()) return setSlice((slice) => ({ ...slice, at: null, zoom: 1 }), false);
  setPose({ ...HOME, shift: null }, { moving: false });
}

onGestures($("stage"), $("divider"), {
  turn(dx, dy) {
    const [, height] = stage.size;
    if (slicing()) return pan([dx / height, dy / height]);
    // Half a turn across the stage's height; finer when close.
    const degrees = 180 / height / Math.max(1, Math.sqrt(state.pose.zoom));
    setPose({ azimuth: state.pose.azimuth - dx * degrees, elevation: state.pose.elevation + dy * degrees });
  },
  pan(dx, dy, mouse) {
    if (slicing() && mouse) return setSlice((slice) => windowed(slice, [dx, dy]));
    pan([dx / stage.size[1], dy / stage.size[1]]);
  },
  zoom(ratio, { wheel, at }) {
    if (slicing() && wheel && !wheel.ctrlKey) return page(Math.sign(ratio - 1));
    zoom(ratio, at);
  },
  click: (at, { shiftKey }) => picks.at(at, shiftKey),
  double: reset,
});

onDivider($("stage"), $("divider"), (fraction) => {
  state.split = Math.min(0.98, Math.max(0.02, fraction));
  describe();
  stage.draw();
});

function setView(view) {
  state.view = view;
  choose("view", view);
  picks.draw();
  // The displayed picture may already be sufficient.
  if (!stage.holds(view)) return refresh();
  stage.draw();
  describe();
}

function setPreset(index) {
  if (!presets[index]) return;
  state.own.preset = true;
  const { name, mode } = presets[index];
  Object.assign(state, { preset: name, mode });
  describePreset();
  refresh();
}

function describePreset() {
  $("mode").value = state.mode;
  describeSurface(state);
  describeLight(state);
  describeFaces(state);
  markPreset();
}

/** Marks the preset among the others; without one, explains the look. */
function markPreset() {
  const index = presets.findIndex(({ name }) => name === state.preset);
  grid.choose(index);
  $("purpose").textContent = presets[index]?.purpose ?? `All values of type ${state.volume?.unit}, the higher the more opaque. Presets are made for HU.`;
}

/** The preset and the window of slices that suit a volume, where the user chose none; no preset suits values that are not HU. */
function follow({ anatomy }) {
  if (!state.own.preset) {
    const suited = presets.find(({ name }) => name === anatomy.preset);
    Object.assign(state, { preset: suited?.name ?? null, mode: suited?.mode ?? "composite" });
    describePreset();
  }
  if (!state.own.window) {
    const [center, width] = anatomy.window_hu;
    state.slice = { ...state.slice, center, width };
  }
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else $("stage").requestFullscreen?.().catch(() => notify("This browser refuses full screen."));
}

onKeys({
  pose: setPose, plane: showPlane, preset: setPreset, page, pan, zoom, reset, fullScreen,
  forget: () => picks.forget(),
  nextView: () => setView(VIEWS[(VIEWS.indexOf(state.view) + 1) % VIEWS.length]),
  nextMode() {
    $("mode").selectedIndex = ($("mode").selectedIndex + 1) % $("mode").length;
    $("mode").dispatchEvent(new Event("change", { bubbles: true }));
  },
  cine() {
    if (slicing()) cine.toggle();
    else if (phases.exist) phases.cine.toggle();
  },
  nextPlane() {
    const planes = ["", ...Object.keys(PLANES)];
    showPlane(planes[(planes.indexOf(state.slice.plane) + 1) % planes.length]);
  },
});

// ---------------------------------------------------------------- settings

panel.addEventListener("submit", (event) => event.preventDefault());
$("preset-search").addEventListener("input", ({ target }) => {
  $("no-preset").hidden = grid.find(target.value) > 0;
});
$("preset-search").addEventListener("keydown", ({ key }) => {
  if (key === "Enter" && grid.first !== undefined) setPreset(grid.first);
});

panel.addEventListener("change", ({ target }) => {
  if (target.name === "view") return setView(target.value);
  if (target.name === "plane") return showPlane(target.value);
  if (target.id === "mode") state.mode = target.value;
  else if (target.name === "overlay") state.overlays = overlayBoxes().filter((box) => box.checked).map((box) => box.value);
  else if (target.name === "projection") state.fieldOfView = Number(target.value);
  else if (target.name === "preset") return setPreset(Number(target.value));
  else if (target.id === "depth-filter") state.depthFilter = target.value;
  else if (target.id === "depth-rule") state.depthRule = target.value;
  else if (target.id === "layout" || target.id === "profile") {
    state[target.id] = target.value;
    preview.changed();
    return state.view === "frame" ? refresh() : remember();
  } else return;
  describeSurface(state);
  describeLight(state);
  describeFaces(state);
  refresh();
});
onSurface(state, () => refresh({ moving: true }));
onLight(state, () => refresh({ moving: true }));
onControls($, () => state.volume, setSlice);
onSegments(() => state.labels, (labels, moving) => {
  state.labels = labels;
  refresh({ moving });
});

for (const id of ["factor", "offset"]) {
  $(id).addEventListener("input", ({ target }) => {
    state[id] = Number(target.value);
    describeHeader();
    preview.changed();
    // The depth view applies them locally; a frame has to be requested again.
    if (state.view === "frame") return refresh({ moving: true });
    stage.draw();
    remember();
  });
}

function describeHeader() {
  for (const id of ["factor", "offset"]) $(id).value = state[id];
  $("factor-value").textContent = `${Math.round((state.factor / 64) * 100)} %`;
  $("offset-value").textContent = String(state.offset);
}

/** Updates all controls from the state. */
function showState() {
  for (const [id, key] of [["mode", "mode"], ["layout", "layout"], ["profile", "profile"], ["depth-filter", "depthFilter"], ["depth-rule", "depthRule"]]) {
    $(id).value = state[key];
  }
  const radios = { view: state.view, plane: state.slice.plane, projection: state.fieldOfView, preview: state.preview };
  for (const [name, value] of Object.entries(radios)) choose(name, value);
  for (const box of overlayBoxes()) box.checked = state.overlays.includes(box.value);
  markPreset();
  $("table").checked = state.table === "keep";
  $("crop-group").open = state.crop !== null || state.planes.length > 0 || state.table === "keep" || state.faces === "slice";
  describeSurface(state);
  describeLight(state);
  describeFaces(state);
  describeHeader();
  describe();
}

$("table").addEventListener("change", ({ target }) => setCrop({ table: target.checked ? "keep" : "remove" }));
$("cut-slice").addEventListener("change", ({ target }) => setCrop({ faces: target.checked ? "slice" : "lit" }));
$("crop-reset").addEventListener("click", () => {
  setCrop({ crop: null, planes: [] });
  planes.draw();
});
$("reset").addEventListener("click", reset);
$("full-screen").addEventListener("click", fullScreen);
$("help-button").addEventListener("click", showHelp);

// ---------------------------------------------------------------- downloads and uploads

async function save(button, part, accept, ending) {
  if (!state.volume) return;
  const { azimuth, elevation } = state.pose;
  const view = `${state.preset ?? "values"}-az${azimuth.toFixed(0)}-el${elevation.toFixed(0)}`;
  const name = `relief-${slicing() ? state.slice.plane : view}-${part}.${ending}`;
  button.disabled = true;
  await saveAs(name, `${volumePath(part)}?${frameQuery(state)}`, accept).catch(showFailure);
  button.disabled = false;
}

$("save-frame").addEventListener("click", ({ currentTarget }) => save(currentTarget, "frame", "image/png", "png"));
$("save-exr").addEventListener("click", ({ currentTarget }) => save(currentTarget, "frame", "image/x-exr", "exr"));
$("save-depth").addEventListener("click", ({ currentTarget }) => save(currentTarget, "depth", "image/png", "png"));

$("copy-link").addEventListener("click", async () => {
  if (!state.volume) return;
  const address = `${location.origin}${volumePath("frame")}?${frameQuery(state)}`;
  try {
    await navigator.clipboard.writeText(address);
    notify("Copied: the address answers with the frame as it is now.");
  } catch {
    notify(address); // clipboards are for secure pages alone
  }
});

onFile($("stage"), [$("upload-button"), $("empty-button")], $("upload"), async (file) => {
  notify(`Reading ${file.name} …`);
  try {
    const { id } = await uploadZip(file);
    await showVolumeOf(id);
  } catch (error) {
    showFailure(Object.assign(error, { message: `${file.name}: ${error.message}` }));
  }
});

// ---------------------------------------------------------------- volumes

const option = (value, text = value) => new Option(text, value);

function facts(volume) {
  const [low, high] = volume.hu_range;
  return [`${volume.dims.join(" × ")} voxels`, spacingWords(volume), `${low} to ${high} ${volume.unit}`].join(DOT);
}

/** Displays another phase of the series: everything else stays. */
function showPhase(volume, moving) {
  if (!volume) return;
  state.volume = volume;
  describeVolume(volume);
  refresh({ moving });
}

function describeVolume(volume) {
  $("series").textContent = identityOf(volume);
  showWarnings($("series-warnings"), volume);
  volumeMenu.choose(volume.id);
  $("volume-facts").textContent = facts(volume);
  nameUnit(volume);
  phases.fill(volume, volumes);
  picks.forget();
}

function showVolume(volume) {
  if (!volume) return;
  if (stage.shown !== null && arePhases(volume, state.volume)) return showPhase(volume, false);
  const isUnlinked = linked !== null && linked !== volume.id;
  const isAnother = stage.shown !== null || isUnlinked;
  linked = null;
  state.volume = volume;
  // The camera of the link was for another series.
  if (isUnlinked) state.pose = { ...HOME, shift: null };
  // Positions in one volume do not apply to another.
  if (isAnother) {
    state.slice = { ...state.slice, at: null };
    state.pose = { ...state.pose, shift: null };
    state.labels = { ...state.labels, cut: [] };
    Object.assign(state, { crop: null, planes: [] });
  }
  cine.stop();
  follow(volume);
  $("empty").hidden = true;
  $("missing").hidden = true;
  $("notice").hidden = true;
  phases.cine.stop();
  showSegments(volume, state.labels);
  describeVolume(volume);
  refresh();
  grid.show(`/v1/volumes/${volume.id}`);
  if (!$("adapter").textContent) describeAdapter().catch(showFailure);
}

/** Displays a volume that has just been added. */
async function showVolumeOf(id) {
  await listVolumes();
  showVolume(volumes.find((volume) => volume.id === id));
}

async function listVolumes() {
  const listed = await (await request("/v1/volumes")).json();
  volumes = listed.volumes;
  volumeMenu.fill(volumes);
  $("volume-field").hidden = volumes.length < 2;
  if (state.volume) phases.fill(volumes.find(({ id }) => id === state.volume.id) ?? state.volume, volumes);
  if (state.volume) volumeMenu.choose(state.volume.id);
  return listed.loading;
}

/** Waits for the volume of the address or the first one, and for those that are still loading. */
async function awaitVolumes() {
  for (;;) {
    const loading = await listVolumes();
    if (!state.volume) showVolume(linked === null ? volumes[0] : volumes.find(({ id }) => id === linked));
    const isMissing = !state.volume && linked !== null && !loading;
    if (isMissing) offerOthers($("missing"), volumes, showVolume);
    else if (!loading) break;
    if (!state.volume) $("timing").textContent = isMissing ? "no such series" : "loading the series …";
    await new Promise((resolve) => setTimeout(resolve, isMissing ? 2000 : 700));
  }
  if (volumes.length) return;
  $("timing").textContent = "no volume";
  $("empty").hidden = false;
}

async function start() {
  await showIdentity($("identity"));
  const picture = () => state.volume && `${volumePath("frame")}/store?${frameQuery(state)}`;
  await showArchives({ loaded: showVolumeOf, picture });
  const known = await (await request("/v1/presets")).json();
  presets = known.presets;
  grid.fill(presets);
  $("layout").replaceChildren(...known.layouts.map((name) => option(name)));
  fillLights(known.lights);
  $("depth-rule").replaceChildren(option("", "as the layout needs"), ...known.depth_rules.map((name) => option(name)));
  $("depth-filter").replaceChildren(...known.depth_filters.map((name) => option(name)));
  $("profile").append(...known.profiles.map((name) => option(name)));
  linked = recall(presets);
  showState();
  await awaitVolumes();
}

/** Displays the name of the adapter, which is known once a volume is loaded. */
async function describeAdapter() {
  const { adapter } = await (await request("/readyz")).json();
  Object.assign($("adapter"), { textContent: adapter, title: adapter });
}

// Another link in the same window.
addEventListener("hashchange", () => location.reload());

start().catch(showFailure);
